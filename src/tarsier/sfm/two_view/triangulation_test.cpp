// SPDX-License-Identifier: MIT
#include "tarsier/sfm/two_view/triangulation.h"

#include "tarsier/core/rng.h"

#include <gtest/gtest.h>
#include <opencv2/calib3d.hpp>

#include <cmath>

namespace tarsier::sfm {
namespace {

// A camera at `center` that looks along z, slightly rotated.
geometry::Rigid3 camera_at(const Eigen::Vector3d& center, double turn) {
  const Eigen::Matrix3d rotation = geometry::rotation_by({0.1 * turn, turn, -0.05 * turn});
  return {rotation, -(rotation * center)};
}

cv::Point2d ray_to(const geometry::Rigid3& pose, const Eigen::Vector3d& point) {
  const Eigen::Vector3d p = pose * point;
  return {p[0] / p[2], p[1] / p[2]};
}

TEST(Triangulate, IsExactWithoutNoise) {
  Rng rng(1);
  for (int trial = 0; trial < 50; ++trial) {
    const Eigen::Vector3d point(rng.uniform(-2, 2), rng.uniform(-2, 2), rng.uniform(4, 9));
    std::vector<ObservationRay> rays;
    for (int k = 0; k < 2 + trial % 3; ++k) {
      const geometry::Rigid3 pose =
          camera_at({rng.uniform(-2, 2), rng.uniform(-1, 1), 0}, rng.uniform(-0.2, 0.2));
      rays.push_back({pose, ray_to(pose, point)});
    }
    const auto found = triangulate(rays);
    ASSERT_TRUE(found.has_value());
    EXPECT_LT((*found - point).norm(), 1e-6);
  }
}

TEST(Triangulate, MinimizesSquaredError) {
  Rng rng(2);
  const Eigen::Vector3d point(0.3, -0.2, 5);
  std::vector<ObservationRay> rays;
  for (int k = 0; k < 5; ++k) {
    const geometry::Rigid3 pose = camera_at({0.5 * k - 1, 0, 0}, 0.02 * k);
    const cv::Point2d ray = ray_to(pose, point);
    rays.push_back({pose, {ray.x + rng.normal(0, 2e-3), ray.y + rng.normal(0, 2e-3)}});
  }
  const auto cost = [&](const Eigen::Vector3d& x) {
    double sum = 0;
    for (const ObservationRay& seen : rays) {
      const cv::Point2d d = ray_to(seen.pose, x) - seen.ray;
      sum += d.dot(d);
    }
    return sum;
  };
  const auto found = triangulate(rays);
  ASSERT_TRUE(found.has_value());
  for (int axis = 0; axis < 3; ++axis) {
    for (const double step : {-1e-3, 1e-3}) {
      Eigen::Vector3d moved = *found;
      moved[axis] += step;
      EXPECT_GT(cost(moved), cost(*found));
    }
  }
}

TEST(Triangulate, IsEmptyWhereUndetermined) {
  const geometry::Rigid3 pose = camera_at({0, 0, 0}, 0);
  EXPECT_FALSE(triangulate({}).has_value());
  EXPECT_FALSE(triangulate({{pose, {0.1, 0}}}).has_value());
  // Rays that meet behind the cameras.
  const geometry::Rigid3 beside = camera_at({1, 0, 0}, 0);
  EXPECT_FALSE(triangulate({{pose, {-0.2, 0}}, {beside, {0.2, 0}}}).has_value());
}

TEST(RayAngle, IsAngleAtPoint) {
  EXPECT_NEAR(ray_angle({0, 0, 1}, {0, 0, 0}, {1, 0, 1}), CV_PI / 2, 1e-12);
  EXPECT_NEAR(ray_angle({0, 0, 1}, {0, 0, 0}, {0, 0, -1}), 0, 1e-12);
}

}  // namespace
}  // namespace tarsier::sfm
