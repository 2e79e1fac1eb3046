// SPDX-License-Identifier: MIT
#include "tarsier/geometry/rigid.h"

#include "tarsier/core/rng.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

namespace tarsier::geometry {
namespace {

constexpr double kPi = std::numbers::pi;

cv::Matx33d turned(const cv::Vec3d& axis, double angle) {
  const cv::Vec3d u = axis * (1 / cv::norm(axis)) * std::sin(angle / 2);
  return rotation_of({std::cos(angle / 2), u[0], u[1], u[2]});
}

TEST(RigidTest, AQuaternionTurnsByTheRightHandRule) {
  const cv::Matx33d r = turned({0, 0, 1}, kPi / 2);
  EXPECT_LT(cv::norm(r * cv::Vec3d(1, 0, 0) - cv::Vec3d(0, 1, 0)), 1e-15);
  EXPECT_LT(cv::norm(rotation_of({2, 0, 0, 2}) - r), 1e-15);  // any length
}

TEST(RigidTest, QuaternionsComeBackAlsoFromHalfTurns) {
  Rng rng(1);
  for (int k = 0; k < 2000; ++k) {
    cv::Vec4d q(rng.normal(), rng.normal(), rng.normal(), rng.normal());
    if (k % 4 == 1) q[0] *= 1e-9;  // nearly a half turn
    if (k % 4 == 2) q[0] = 0;
    if (k % 4 == 3) q = {1, 1e-9 * q[1], 1e-9 * q[2], 1e-9 * q[3]};
    q *= (q[0] < 0 ? -1 : 1) / cv::norm(q);
    const cv::Matx33d r = rotation_of(q);
    EXPECT_LT(cv::norm(r * r.t() - cv::Matx33d::eye()), 1e-14);
    EXPECT_NEAR(cv::determinant(r), 1, 1e-14);
    const cv::Vec4d back = quaternion_of(r);
    EXPECT_GE(back[0], 0);
    EXPECT_NEAR(cv::norm(back), 1, 1e-15);
    // At a half turn both signs are the same rotation.
    EXPECT_LT(std::min(cv::norm(back - q), q[0] < 1e-6 ? cv::norm(back + q) : 1.0), 1e-14);
  }
}

TEST(RigidTest, TheAngleIsExactFromNoneToAHalfTurn) {
  EXPECT_EQ(angle_of(cv::Matx33d::eye()), 0);
  for (const double angle : {1e-12, 1e-8, 1e-3, 1.0, kPi / 2, 3.0, kPi - 1e-8, kPi})
    EXPECT_NEAR(angle_of(turned({1, -2, 0.5}, angle)), angle, 1e-15 + 1e-14 * angle);
  EXPECT_NEAR(angle_of(turned({1, 0, 0}, -0.5)), 0.5, 1e-15);
}

TEST(RigidTest, InverseAndCenterAgree) {
  const Rigid a{turned({1, 2, 3}, 0.7), {1, -2, 3}};
  const Rigid b{turned({-1, 0, 1}, 2.5), {0.5, 0, -4}};
  const cv::Vec3d x(3, 1, 4);
  EXPECT_LT(cv::norm((a * b) * x - a * (b * x)), 1e-14);
  EXPECT_LT(cv::norm(a.inverse() * (a * x) - x), 1e-14);
  EXPECT_LT(cv::norm(a * a.center()), 1e-14);
  EXPECT_LT(cv::norm(a.inverse().translation - a.center()), 1e-15);
}

TEST(RigidTest, NoRotationIsACallersMistake) {
  EXPECT_THROW((void)rotation_of({0, 0, 0, 0}), std::invalid_argument);
  EXPECT_THROW((void)rotation_of({NAN, 0, 0, 0}), std::invalid_argument);
  EXPECT_THROW((void)quaternion_of(NAN * cv::Matx33d::eye()), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::geometry
