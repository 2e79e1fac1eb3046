// SPDX-License-Identifier: MIT
#include "tarsier/geometry/planar_pose.h"

#include "tarsier/core/rng.h"
#include "tarsier/geometry/opencv_types.h"

#include <gtest/gtest.h>
#include <opencv2/calib3d.hpp>

#include <cmath>
#include <limits>
#include <vector>

namespace tarsier::geometry {
namespace {

Camera test_camera() {
  Camera camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = 610;
  camera.fy = 600;
  camera.cx = 322;
  camera.cy = 238;
  return camera;
}

const std::vector<cv::Point2d> kSquare{{-0.03, 0.03}, {0.03, 0.03}, {0.03, -0.03}, {-0.03, -0.03}};

Rigid3 pose_of(double tilt, double about, double roll, const Eigen::Vector3d& translation) {
  const Eigen::Vector3d axis(std::cos(about), std::sin(about), 0);
  const Eigen::Matrix3d turned = rotation_by(axis * tilt);
  const Eigen::Matrix3d rolled = rotation_by({0, 0, roll});
  // The plane's z axis points to the camera.
  const Eigen::Matrix3d facing{{1, 0, 0}, {0, -1, 0}, {0, 0, -1}};
  return {turned * rolled * facing, translation};
}

std::vector<cv::Point2d> projected(const Camera& camera, const Rigid3& pose,
                                   const std::vector<cv::Point2d>& points) {
  std::vector<cv::Point2d> pixels;
  for (const cv::Point2d& p : points)
    pixels.push_back(camera.project(pose * Eigen::Vector3d(p.x, p.y, 0)).value());
  return pixels;
}

double degrees_between(const Rigid3& a, const Rigid3& b) {
  return angle_of(a.rotation.transpose() * b.rotation) * 180 / CV_PI;
}

TEST(PlanarPose, RecoversExactlyWithoutNoise) {
  Camera camera = test_camera();
  camera.distortion = {-0.2, 0.05, 0.001, -0.002, 0};
  Rng rng(1);
  for (int i = 0; i < 200; ++i) {
    const Rigid3 truth =
        pose_of(rng.uniform(0.0, 1.1), rng.uniform(0.0, 6.28), rng.uniform(0.0, 6.28),
                {rng.uniform(-0.1, 0.1), rng.uniform(-0.1, 0.1), rng.uniform(0.3, 1.0)});
    const auto found = planar_poses(kSquare, projected(camera, truth, kSquare), camera);
    ASSERT_TRUE(found) << i;
    EXPECT_LT(degrees_between(found->best.camera_from_plane, truth), 0.01) << i;
    EXPECT_LT((found->best.camera_from_plane.translation - truth.translation).norm(), 1e-5);
    EXPECT_LT(found->best.rms_px, 1e-4);
  }
}

TEST(PlanarPose, BothSolutionsOfASmallTiltedSquareAreGiven) {
  const Camera camera = test_camera();
  // 18 px wide: nearly no perspective.
  const Rigid3 truth = pose_of(0.6, 0.3, 0.2, {0.02, 0.01, 2.0});
  const auto found = planar_poses(kSquare, projected(camera, truth, kSquare), camera);
  ASSERT_TRUE(found);
  ASSERT_TRUE(found->other);
  EXPECT_LT(degrees_between(found->best.camera_from_plane, truth), 0.1);
  EXPECT_GT(degrees_between(found->other->camera_from_plane, truth), 20);
  EXPECT_LT(found->other->rms_px, 1.0);
  EXPECT_GT(found->ambiguity_ratio(), 10);  // without noise the two solutions differ clearly
}

TEST(PlanarPose, IsAsGoodAsTheBestOfOpencvUnderNoise) {
  const Camera camera = test_camera();
  Rng rng(2);
  std::vector<cv::Point3d> object;
  for (const cv::Point2d& p : kSquare) object.emplace_back(p.x, p.y, 0);
  double our_error = 0;
  double opencv_error = 0;
  int flips = 0;
  const int trials = 300;
  for (int i = 0; i < trials; ++i) {
    const Rigid3 truth = pose_of(rng.uniform(0.3, 1.0), rng.uniform(0.0, 6.28),
                                 rng.uniform(0.0, 6.28), {0.02, -0.03, rng.uniform(0.3, 0.6)});
    std::vector<cv::Point2d> pixels = projected(camera, truth, kSquare);
    for (cv::Point2d& p : pixels) p += cv::Point2d(rng.normal(0, 0.1), rng.normal(0, 0.1));
    const auto found = planar_poses(kSquare, pixels, camera);
    ASSERT_TRUE(found);
    const double error = degrees_between(found->best.camera_from_plane, truth);
    flips += error > 15;
    std::vector<cv::Mat> rvecs;
    std::vector<cv::Mat> tvecs;
    cv::solvePnPGeneric(object, pixels, camera.matrix(), cv::noArray(), rvecs, tvecs, false,
                        cv::SOLVEPNP_IPPE_SQUARE);
    const Rigid3 opencv_pose{rotation_by(to_eigen(cv::Vec3d(rvecs[0])))};
    our_error += std::min(error, 15.0);
    opencv_error += std::min(degrees_between(opencv_pose, truth), 15.0);
  }
  EXPECT_LE(flips, 1);
  EXPECT_LT(our_error, opencv_error * 1.02);
}

TEST(PlanarPose, HandlesManyPointsAwayFromTheOrigin) {
  const Camera camera = test_camera();
  std::vector<cv::Point2d> grid;
  for (int y = 0; y < 6; ++y)
    for (int x = 0; x < 9; ++x) grid.emplace_back(0.1 + 0.02 * x, -0.3 + 0.02 * y);
  const Rigid3 truth = pose_of(0.5, 1.0, 0.4, {-0.1, 0.05, 0.9});
  const auto found = planar_poses(grid, projected(camera, truth, grid), camera);
  ASSERT_TRUE(found);
  EXPECT_LT(degrees_between(found->best.camera_from_plane, truth), 1e-3);
}

TEST(PlanarPose, IsEmptyForDegeneratePoints) {
  const Camera camera = test_camera();
  const std::vector<cv::Point2d> line{{100, 100}, {200, 200}, {300, 300}, {400, 400}};
  EXPECT_FALSE(planar_poses(kSquare, line, camera));
  const std::vector<cv::Point2d> point(4, {100, 100});
  EXPECT_FALSE(planar_poses(kSquare, point, camera));
  std::vector<cv::Point2d> broken = projected(camera, pose_of(0.2, 0, 0, {0, 0, 1}), kSquare);
  broken[2].x = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(planar_poses(kSquare, broken, camera));
  EXPECT_FALSE(planar_poses(std::span(kSquare).first(3), std::span(line).first(3), camera));
  EXPECT_THROW((void)planar_poses(kSquare, std::span(line).first(3), camera),
               std::invalid_argument);
}

TEST(Homography, IsExactForFourPointsAndLeastSquaresForMore) {
  const cv::Matx33d truth(1.1, 0.2, 30, -0.1, 0.9, 12, 0.0004, -0.0002, 1);
  const std::vector<cv::Point2d> from{{0, 0}, {200, 0}, {200, 100}, {0, 100}, {50, 60}};
  std::vector<cv::Point2d> to;
  for (const cv::Point2d& p : from) to.push_back(mapped(truth, p));
  for (const std::size_t n : {std::size_t{4}, std::size_t{5}}) {
    const auto h = homography_of(std::span(from).first(n), std::span(to).first(n));
    ASSERT_TRUE(h);
    for (std::size_t i = 0; i < from.size(); ++i)
      EXPECT_LT(cv::norm(mapped(*h, from[i]) - to[i]), 1e-6);
  }
}

TEST(Homography, RefusesPointsOnOneLine) {
  const std::vector<cv::Point2d> from{{0, 0}, {1, 0}, {2, 0}, {3, 5}};  // three on one line
  const std::vector<cv::Point2d> to{{0, 0}, {10, 1}, {20, 5}, {30, 50}};
  EXPECT_FALSE(homography_of(from, to));
}

TEST(PlanarPose, PixelsAreWeightedByTheInformationMatrix) {
  const Camera camera = test_camera();
  const std::vector<cv::Point2d> plane{
      {-0.05, 0.05}, {0.05, 0.05}, {0.05, -0.05}, {-0.05, -0.05}, {0.0, 0.05}};
  const Rigid3 truth{Eigen::Matrix3d{{1, 0, 0}, {0, -0.8, -0.6}, {0, 0.6, -0.8}},
                     {0.02, 0.01, 0.7}};
  std::vector<cv::Point2d> pixels;
  for (const cv::Point2d& p : plane)
    pixels.push_back(camera.project(truth * Eigen::Vector3d(p.x, p.y, 0)).value());
  pixels[4] += {3, -4};  // a known outlier
  PlanarPoseOptions options;
  options.information.assign(100, 0);
  for (std::size_t i = 0; i < 10; ++i) options.information[i * 11] = i < 8 ? 100 : 1e-8;
  const auto plain = planar_poses(plane, pixels, camera);
  const auto weighted = planar_poses(plane, pixels, camera, options);
  ASSERT_TRUE(plain && weighted);
  EXPECT_GT((plain->best.camera_from_plane.rotation - truth.rotation).norm(), 0.02);
  EXPECT_LT((weighted->best.camera_from_plane.rotation - truth.rotation).norm(), 1e-5);
  EXPECT_NEAR(weighted->best.rms_px, std::sqrt(5.0), 1e-3);  // px: 5 px in one of five
  EXPECT_LT(weighted->best.misfit, 1e-3);
  options.information.pop_back();
  EXPECT_THROW((void)planar_poses(plane, pixels, camera, options), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::geometry
