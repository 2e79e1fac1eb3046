// SPDX-License-Identifier: MIT
#include "tarsier/geometry/camera.h"

#include "tarsier/core/rng.h"

#include <gtest/gtest.h>
#include <opencv2/calib3d.hpp>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <vector>

namespace tarsier::geometry {
namespace {

Camera phone() {
  return {640, 480, 520.5, 518.25, 321, 238.5, {-0.28, 0.09, 1e-3, -2e-3, -0.01}, 0};
}

TEST(CameraTest, ProjectsAsOpenCvDoes) {
  const Camera camera = phone();
  Rng rng(3);
  std::vector<cv::Point3d> points;
  for (int k = 0; k < 200; ++k)
    points.emplace_back(rng.uniform(-2, 2), rng.uniform(-2, 2), rng.uniform(2.5, 9));
  std::vector<cv::Point2d> expected;
  cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), cv::Mat(camera.matrix()),
                    std::vector<double>(camera.distortion.begin(), camera.distortion.end()),
                    expected);
  for (std::size_t k = 0; k < points.size(); ++k) {
    const auto pixel = camera.project({points[k].x, points[k].y, points[k].z});
    ASSERT_TRUE(pixel);
    EXPECT_LT(cv::norm(*pixel - expected[k]), 1e-9);
  }
}

TEST(CameraTest, RationalAndFisheyeProjectAsOpenCvDoes) {
  Camera rational = phone();
  rational.lens = Lens::kRational;
  rational.distortion = {-0.2, 0.1, 1e-3, -2e-3, 0.02, 0.1, 0.05, 0.01};
  Camera fisheye = phone();
  fisheye.lens = Lens::kFisheye;
  fisheye.distortion = {0.05, -0.02, 4e-3, -1e-3};
  Rng rng(3);
  std::vector<cv::Point3d> points;
  for (int k = 0; k < 200; ++k)
    points.emplace_back(rng.uniform(-5, 5), rng.uniform(-5, 5), rng.uniform(2.5, 9));
  std::vector<cv::Point2d> expected;
  cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), cv::Mat(rational.matrix()),
                    std::vector<double>(rational.distortion.begin(), rational.distortion.end()),
                    expected);
  std::vector<cv::Point2d> bent;
  cv::fisheye::projectPoints(points, bent, cv::Vec3d(), cv::Vec3d(), fisheye.matrix(),
                             cv::Vec4d(fisheye.distortion.data()));
  for (std::size_t k = 0; k < points.size(); ++k) {
    const Eigen::Vector3d p(points[k].x, points[k].y, points[k].z);
    EXPECT_LT(cv::norm(rational.project(p).value() - expected[k]), 1e-9);
    EXPECT_LT(cv::norm(fisheye.project(p).value() - bent[k]), 1e-9);
  }
}

TEST(CameraTest, PointsBehindTheCameraAreNotProjected) {
  const Camera camera = phone();
  EXPECT_FALSE(camera.project({0, 0, -1}));
  EXPECT_FALSE(camera.project({0, 0, 0}));
  EXPECT_FALSE(camera.project({0, 0, std::numeric_limits<double>::quiet_NaN()}));
  EXPECT_EQ(camera.project({0, 0, 2}), cv::Point2d(321, 238.5));
}

TEST(CameraTest, PixelsRoundTrip) {
  std::vector<Camera> cameras(7, phone());
  cameras[0].distortion = {};
  cameras[2].distortion = {0.4, 0.2, -3e-3, 2e-3, 0.1};  // pincushion
  cameras[3].distortion = {-0.35, 0.15, 5e-4, 5e-4, -0.03};
  cameras[4].lens = Lens::kRational;
  cameras[4].distortion = {-0.2, 0.1, 1e-3, -2e-3, 0.02, 0.1, 0.05, 0.01};
  cameras[5].lens = cameras[6].lens = Lens::kFisheye;
  cameras[5].distortion = {};  // equidistant
  cameras[6].distortion = {0.05, -0.02, 4e-3, -1e-3};
  cameras[6].fx = cameras[6].fy = 290;
  for (const Camera& camera : cameras) {
    for (int y = -20; y <= camera.height + 20; y += 10) {
      for (int x = -20; x <= camera.width + 20; x += 10) {
        const auto back = camera.normalized_of(cv::Point2d(x, y));
        ASSERT_TRUE(back) << x << " " << y;
        EXPECT_LT(cv::norm(camera.pixel_of(*back) - cv::Point2d(x, y)), 1e-9);
      }
    }
  }
}

TEST(CameraTest, TheInverseIsExactUpToTheTurningPoint) {
  Camera camera{640, 480, 500, 500, 320, 240, {-0.3, 0, 0, 0, 0}, 0};
  // r (1 - 0.3 r2) grows up to r = sqrt(1 / 0.9) and is 0.7027 there.
  const double turn = std::sqrt(1 / 0.9);
  for (int degrees = 0; degrees < 360; degrees += 15) {
    const double angle = degrees * CV_PI / 180;
    const cv::Point2d direction(std::cos(angle), std::sin(angle));
    for (const double r : {0.0, 1e-9, 0.3, 0.8, 0.99 * turn}) {
      const auto back = camera.normalized_of(camera.pixel_of(r * direction));
      ASSERT_TRUE(back) << r;
      EXPECT_LT(cv::norm(*back - r * direction), 1e-10) << r;
    }
    // No light reaches the pixels outside. The equation has a solution for them, but it lies on the
    // other side and far away.
    const double edge = turn * (1 - 0.3 * turn * turn);
    for (const double r : {1.01 * edge, 1.5 * edge, 5 * edge, 1e6}) {
      const cv::Point2d pixel = 500 * r * direction + cv::Point2d(320, 240);
      EXPECT_FALSE(camera.normalized_of(pixel)) << r;
    }
  }
  // With k2 the function has two turning points. The second rising part is not valid either.
  camera.distortion = {-1, 0.25, 0, 0, 0};
  const cv::Point2d far(3, 0);
  EXPECT_FALSE(camera.normalized_of(camera.pixel_of(far)));
  camera.distortion = {-1.5, 0, 0, 0, 0.5};
  EXPECT_FALSE(camera.normalized_of(camera.pixel_of(far)));
  EXPECT_FALSE(camera.normalized_of({std::numeric_limits<double>::quiet_NaN(), 0}));
}

TEST(CameraTest, AFisheyeRefusesRaysAtNinetyDegrees) {
  Camera camera{640, 480, 200, 200, 320, 240, {}, 0, Lens::kFisheye};
  EXPECT_TRUE(camera.normalized_of({320 + 200 * 1.57, 240}));
  EXPECT_FALSE(camera.normalized_of({320 + 200 * 1.58, 240}));
  EXPECT_EQ(camera.normalized_of({320, 240}), cv::Point2d(0, 0));
  camera.distortion = {-0.3, 0, 0, 0};  // a (1 - 0.3 a2) turns at a = 1.054
  EXPECT_NEAR(camera.largest_radius(100), std::tan(std::sqrt(1 / 0.9)), 1e-9);
  EXPECT_FALSE(camera.normalized_of({320 + 200 * 0.71, 240}));
  EXPECT_TRUE(camera.normalized_of({320 + 200 * 0.70, 240}));
}

TEST(CameraTest, TheLargestRadiusIsTheTurningPoint) {
  Camera camera = phone();
  camera.distortion = {};
  EXPECT_EQ(camera.largest_radius(20), 20);
  camera.distortion = {-0.3};
  EXPECT_NEAR(camera.largest_radius(20), std::sqrt(1 / 0.9), 1e-9);
  camera.lens = Lens::kRational;
  camera.distortion = {};
  camera.distortion[5] = -0.25;  // a pole at r = 2
  EXPECT_NEAR(camera.largest_radius(20), 2, 1e-9);
  camera.distortion[5] = 0.25;  // r / (1 + r2 / 4) turns at 2
  EXPECT_NEAR(camera.largest_radius(20), 2, 1e-6);
}

TEST(CameraTest, CheckNamesTheBadValue) {
  EXPECT_NO_THROW(phone().check());
  const auto refused = [](const auto& change) {
    Camera camera = phone();
    change(camera);
    EXPECT_THROW(camera.check(), std::invalid_argument);
  };
  refused([](Camera& c) { c.width = 0; });
  refused([](Camera& c) { c.height = -1; });
  refused([](Camera& c) { c.fx = 0; });
  refused([](Camera& c) { c.fy = INFINITY; });
  refused([](Camera& c) { c.cx = NAN; });
  refused([](Camera& c) { c.distortion[4] = NAN; });
  refused([](Camera& c) { c.distortion[5] = 0.1; });
  refused([](Camera& c) { c.lens = Lens::kFisheye; });
}

}  // namespace
}  // namespace tarsier::geometry
