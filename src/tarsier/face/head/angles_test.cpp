// SPDX-License-Identifier: MIT
#include "tarsier/face/head/angles.h"

#include "tarsier/core/rng.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace tarsier::face::head {
namespace {

// Directions of the nose and of the head's top in the camera's frame (x right, y down, z forward).
Eigen::Vector3d nose(const HeadAngles& angles) {
  return rotation_of_angles(angles) * Eigen::Vector3d(0, 0, -1);
}
Eigen::Vector3d crown(const HeadAngles& angles) {
  return rotation_of_angles(angles) * Eigen::Vector3d(0, -1, 0);
}

TEST(Angles, ZeroAnglesAreTheIdentity) {
  EXPECT_LT((rotation_of_angles({}) - Eigen::Matrix3d::Identity()).norm(), 1e-15);
}

TEST(Angles, SignsAreAsDefined) {
  EXPECT_LT(nose({30, 0, 0})[0], -0.4);  // yaw +: to image left
  EXPECT_NEAR(nose({30, 0, 0})[1], 0, 1e-12);
  EXPECT_LT(nose({0, 30, 0})[1], -0.4);  // pitch +: up, y points down
  EXPECT_NEAR(nose({0, 30, 0})[0], 0, 1e-12);
  EXPECT_GT(crown({0, 0, 30})[0], 0.4);  // roll +: clockwise as seen, the crown to image right
  EXPECT_NEAR(nose({0, 0, 30})[2], -1, 1e-12);
}

TEST(Angles, RotationIsTheProductOfRollPitchYaw) {
  const double yaw = 0.5, pitch = 0.3, roll = -0.2;
  const Eigen::Matrix3d rz{
      {std::cos(roll), -std::sin(roll), 0}, {std::sin(roll), std::cos(roll), 0}, {0, 0, 1}};
  const Eigen::Matrix3d rx{
      {1, 0, 0}, {0, std::cos(-pitch), -std::sin(-pitch)}, {0, std::sin(-pitch), std::cos(-pitch)}};
  const Eigen::Matrix3d ry{
      {std::cos(yaw), 0, std::sin(yaw)}, {0, 1, 0}, {-std::sin(yaw), 0, std::cos(yaw)}};
  const double degrees = 180 / std::numbers::pi;
  EXPECT_LT(
      (rotation_of_angles({yaw * degrees, pitch * degrees, roll * degrees}) - rz * rx * ry).norm(),
      1e-14);
}

TEST(Angles, RoundTrip) {
  Rng rng(1);
  for (int k = 0; k < 1000; ++k) {
    const double yaw = rng.uniform(-179.9, 179.9);
    const double pitch = rng.uniform(-89.9, 89.9);
    const HeadAngles angles{yaw, pitch, rng.uniform(-179.9, 179.9)};
    const HeadAngles back = angles_of_rotation(rotation_of_angles(angles));
    EXPECT_NEAR(back.yaw_deg, angles.yaw_deg, 1e-9);
    EXPECT_NEAR(back.pitch_deg, angles.pitch_deg, 1e-9);
    EXPECT_NEAR(back.roll_deg, angles.roll_deg, 1e-9);
  }
}

TEST(Angles, GimbalLockKeepsTheRotation) {
  for (const double pitch : {90.0, -90.0}) {
    const Eigen::Matrix3d rotation = rotation_of_angles({25, pitch, 40});
    const HeadAngles angles = angles_of_rotation(rotation);
    EXPECT_NEAR(angles.pitch_deg, pitch, 1e-6);
    EXPECT_LT((rotation_of_angles(angles) - rotation).norm(), 1e-9);
  }
}

}  // namespace
}  // namespace tarsier::face::head
