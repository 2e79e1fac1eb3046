// SPDX-License-Identifier: MIT
#include "tarsier/face/head/smoothing.h"

#include "tarsier/core/angles.h"
#include "tarsier/core/rng.h"
#include "tarsier/face/head/angles.h"
#include "tarsier/face/head/testing_head.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

namespace tarsier::face::head {
namespace {

geometry::Rigid3 pose_of(double yaw, double roll = 0, double x = 0) {
  return {rotation_of_angles({yaw, 0, roll}), {x, 0, 600}};
}

TEST(MeanPose, AveragesAcross180Degrees) {
  const auto mean = mean_pose({pose_of(0, 170, 2), pose_of(0, -170, 4)});
  EXPECT_LT(degrees_between(mean, pose_of(0, 180)), 1e-9);
  EXPECT_NEAR(mean.translation[0], 3, 1e-12);
  EXPECT_LT(degrees_between(mean_pose({pose_of(10), pose_of(20), pose_of(30)}), pose_of(20)), 1e-9);
  EXPECT_THROW((void)mean_pose({}), std::invalid_argument);
}

TEST(MeanFilter, AveragesTheLastPoses) {
  MeanFilter filter(3);
  EXPECT_LT(degrees_between(filter(pose_of(12)), pose_of(12)), 1e-9);
  EXPECT_LT(degrees_between(filter(pose_of(0)), pose_of(6)), 1e-9);
  (void)filter(pose_of(0));
  EXPECT_LT(degrees_between(filter(pose_of(0)), pose_of(0)), 1e-9);
  filter.reset();
  EXPECT_LT(degrees_between(filter(pose_of(40)), pose_of(40)), 1e-9);
  EXPECT_THROW(MeanFilter(0), std::invalid_argument);
}

TEST(OneEuro, ReducesNoiseOfAStillHead) {
  Rng rng(1);
  OneEuroFilter filter;
  double raw = 0;
  double smooth = 0;
  for (int k = 0; k < 300; ++k) {
    const geometry::Rigid3 noisy = pose_of(20 + rng.normal(), rng.normal(), 2 * rng.normal());
    const geometry::Rigid3 out = filter(noisy, k / 30.0);
    if (k < 60) continue;
    raw += degrees_between(noisy, pose_of(20));
    smooth += degrees_between(out, pose_of(20));
  }
  EXPECT_LT(smooth, 0.65 * raw);
}

TEST(OneEuro, FollowsFastRotationWithLittleLag) {
  OneEuroFilter filter;
  double lag = 0;
  for (int k = 0; k < 60; ++k) {
    // 90 degrees a second, through 180 degrees of roll.
    const geometry::Rigid3 pose = pose_of(0, 120 + 3.0 * k, 3.0 * k);
    const geometry::Rigid3 out = filter(pose, k / 30.0);
    if (k > 30) lag = std::max(lag, degrees_between(out, pose));
  }
  EXPECT_LT(lag, 6);
  EXPECT_GT(lag, 0.1);
}

TEST(OneEuro, RestartsWhenTimeGoesBack) {
  OneEuroFilter filter;
  (void)filter(pose_of(0), 1);
  (void)filter(pose_of(0), 2);
  EXPECT_LT(degrees_between(filter(pose_of(50), 0.5), pose_of(50)), 1e-9);
  OneEuroOptions options;
  options.rotation_cutoff_hz = 0;
  EXPECT_THROW(OneEuroFilter{options}, std::invalid_argument);
}

// Variance of an angle about the camera's y axis by a covariance (rad^2).
double degrees_about_y(const Eigen::Matrix3d& covariance) {
  return std::sqrt(covariance(1, 1)) * kDegreesPerRadian;
}

Eigen::Matrix3d covariance_of(double degrees) {
  return Eigen::Matrix3d::Identity() * (degrees / kDegreesPerRadian) *
         (degrees / kDegreesPerRadian);
}

TEST(Smoothing, KeepsUncertaintyOfAStillHead) {
  OneEuroFilter one_euro;
  MeanFilter mean(5);
  for (int k = 0; k < 20; ++k) {
    Eigen::Matrix3d first = covariance_of(3);
    Eigen::Matrix3d second = first;
    (void)one_euro(pose_of(10), k / 30.0, &first);
    (void)mean(pose_of(10), &second);
    EXPECT_NEAR(degrees_about_y(first), 3, 1e-6);
    EXPECT_NEAR(degrees_about_y(second), 3, 1e-6);
  }
}

TEST(Smoothing, UncertaintyIncludesTheLag) {
  MeanFilter mean(3);
  Eigen::Matrix3d covariance = covariance_of(1);
  (void)mean(pose_of(0), &covariance);
  covariance = covariance_of(1);
  (void)mean(pose_of(0), &covariance);
  covariance = covariance_of(4);
  const geometry::Rigid3 out = mean(pose_of(12), &covariance);
  // The mean of the variances, and a lag of 8 degrees.
  EXPECT_LT(degrees_between(out, pose_of(4)), 0.1);
  EXPECT_NEAR(degrees_about_y(covariance), std::sqrt((1 + 1 + 16) / 3.0 + 64), 0.1);

  OneEuroFilter one_euro;
  covariance = covariance_of(2);
  (void)one_euro(pose_of(0), 0, &covariance);
  EXPECT_NEAR(degrees_about_y(covariance), 2, 1e-9);
  covariance = covariance_of(2);
  const geometry::Rigid3 behind = one_euro(pose_of(30), 1 / 30.0, &covariance);
  const double lag = degrees_between(behind, pose_of(30));
  EXPECT_GT(lag, 1);
  EXPECT_NEAR(degrees_about_y(covariance), std::hypot(2, lag), 0.01);
}

}  // namespace
}  // namespace tarsier::face::head
