// SPDX-License-Identifier: MIT
#include "tarsier/face/head/angle_sigma.h"

#include "tarsier/core/rng.h"
#include "tarsier/geometry/rigid3.h"

#include <gtest/gtest.h>

#include <cmath>

namespace tarsier::face::head {
namespace {

HeadAngles random_angles(Rng& rng) {
  const double yaw = rng.uniform(-80, 80);
  const double pitch = rng.uniform(-70, 70);
  return {yaw, pitch, rng.uniform(-170, 170)};
}

TEST(AngleSigma, MatchesTheEffectOfASmallRotation) {
  Rng rng(1);
  for (int k = 0; k < 50; ++k) {
    const HeadAngles angles = random_angles(rng);
    Eigen::Vector3d turn;
    for (double& value : turn) value = 1e-6 * rng.normal();
    const HeadAngles after =
        angles_of_rotation(geometry::rotation_by(turn) * rotation_of_angles(angles));
    const Eigen::Vector3d change(after.yaw_deg - angles.yaw_deg, after.pitch_deg - angles.pitch_deg,
                                 after.roll_deg - angles.roll_deg);
    const Eigen::Matrix3d expected = change * change.transpose();
    const Eigen::Matrix3d found = angle_covariance(angles, turn * turn.transpose());
    EXPECT_LT((found - expected).norm(), 1e-4 * expected.norm()) << k;
  }
}

TEST(AngleSigma, RotationCovarianceInvertsAngleCovariance) {
  Rng rng(2);
  for (int k = 0; k < 50; ++k) {
    const HeadAngles angles = random_angles(rng);
    Eigen::Matrix3d root;
    for (Eigen::Index i = 0; i < 9; ++i) root.data()[i] = 0.1 * rng.normal();
    const Eigen::Matrix3d turn = root * root.transpose();
    const Eigen::Matrix3d again = rotation_covariance(angles, angle_covariance(angles, turn));
    EXPECT_LT((again - turn).norm(), 1e-9 * turn.norm());
  }
}

TEST(AngleSigma, StaysFiniteAtGimbalLock) {
  const Eigen::Matrix3d turn = 1e-4 * Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d found = angle_covariance({0, 90, 0}, turn);
  EXPECT_TRUE(found.allFinite());
  EXPECT_GT(found(0, 0), 100 * found(1, 1));
}

TEST(AngleSigma, CalibrationScalesEachAxisAndAddsItsFloor) {
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();
  covariance(0, 1) = covariance(1, 0) = 0.5;
  const Eigen::Matrix3d found = calibrated(covariance, {{2, 0}, {3, 4}, {1, 1}});
  EXPECT_DOUBLE_EQ(found(0, 0), 4);
  EXPECT_DOUBLE_EQ(found(1, 1), 9 + 16);
  EXPECT_DOUBLE_EQ(found(2, 2), 2);
  EXPECT_DOUBLE_EQ(found(0, 1), 3);
  EXPECT_DOUBLE_EQ(found(1, 0), 3);
}

}  // namespace
}  // namespace tarsier::face::head
