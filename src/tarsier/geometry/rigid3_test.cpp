// SPDX-License-Identifier: MIT
#include "tarsier/geometry/rigid3.h"

#include "tarsier/core/rng.h"
#include "tarsier/geometry/testing_vectors.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

namespace tarsier::geometry {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::Vector4d;

constexpr double kPi = std::numbers::pi;

Rigid3 random_motion(Rng& rng) { return {rotation_by(random_vector(rng)), random_vector(rng)}; }

double difference(const Rigid3& a, const Rigid3& b) {
  return (a.rotation - b.rotation).norm() + (a.translation - b.translation).norm();
}

TEST(Rigid3Test, IsAGroup) {
  Rng rng(3);
  for (int k = 0; k < 100; ++k) {
    const Rigid3 a = random_motion(rng);
    const Rigid3 b = random_motion(rng);
    const Rigid3 c = random_motion(rng);
    const Vector3d x = random_vector(rng);
    EXPECT_LT(difference((a * b) * c, a * (b * c)), 1e-14);
    EXPECT_LT(difference(a * Rigid3{}, a), 1e-15);
    EXPECT_LT(difference(a * a.inverse(), Rigid3{}), 1e-14);
    EXPECT_LT(difference((a * b).inverse(), b.inverse() * a.inverse()), 1e-14);
    EXPECT_LT(((a * b) * x - a * (b * x)).norm(), 1e-14);
    EXPECT_LT((a.inverse() * (a * x) - x).norm(), 1e-14);
    EXPECT_NO_THROW((a * b * c).check());
  }
}

TEST(Rigid3Test, CenterIsWhereTheInverseTakesTheOrigin) {
  Rng rng(4);
  const Rigid3 a = random_motion(rng);
  EXPECT_LT((a * a.center()).norm(), 1e-15);
  EXPECT_EQ(a.inverse().translation, a.center());
}

TEST(Rigid3Test, ColumnsMoveAsPoints) {
  Rng rng(5);
  const Rigid3 a = random_motion(rng);
  Eigen::Matrix3Xd points(3, 4);
  for (int i = 0; i < 4; ++i) points.col(i) = random_vector(rng);
  const Eigen::Matrix3Xd moved = a.apply(points);
  for (int i = 0; i < 4; ++i) EXPECT_LT((moved.col(i) - a * points.col(i)).norm(), 1e-15);
}

TEST(Rigid3Test, CheckRefusesInvalidMotions) {
  Rigid3 motion;
  EXPECT_NO_THROW(motion.check());
  motion.rotation(0, 0) = -1;  // a reflection
  EXPECT_THROW(motion.check(), std::invalid_argument);
  motion.rotation = 1.001 * Matrix3d::Identity();
  EXPECT_THROW(motion.check(), std::invalid_argument);
  EXPECT_TRUE(is_rotation(motion.rotation, 1e-2));
  motion.rotation = NAN * Matrix3d::Identity();
  EXPECT_THROW(motion.check(), std::invalid_argument);
  motion = {Matrix3d::Identity(), {0, INFINITY, 0}};
  EXPECT_THROW(motion.check(), std::invalid_argument);
}

TEST(Rigid3Test, NumbersAreRowByRow) {
  const Matrix3d m{{1, 2, 3}, {4, 5, 6}, {7, 8, 9}};
  EXPECT_EQ(row_major(m), (std::array<double, 9>{1, 2, 3, 4, 5, 6, 7, 8, 9}));
  EXPECT_EQ(from_row_major(row_major(m)), m);
  const auto numbers = packed({m, {10, 11, 12}});
  EXPECT_EQ(numbers, (std::array<double, 12>{1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12}));
  EXPECT_EQ(difference(unpacked(numbers), {m, {10, 11, 12}}), 0);
}

TEST(Rotation, AQuaternionTurnsByTheRightHandRule) {
  const Matrix3d r = rotation_of({std::cos(kPi / 4), 0, 0, std::sin(kPi / 4)});
  EXPECT_LT((r * Vector3d(1, 0, 0) - Vector3d(0, 1, 0)).norm(), 1e-15);
  EXPECT_LT((rotation_of({2, 0, 0, 2}) - r).norm(), 1e-15);  // any length
  EXPECT_LT((rotation_by({0, 0, kPi / 2}) - r).norm(), 1e-15);
}

TEST(Rotation, QuaternionsRoundTripAlsoForHalfTurns) {
  Rng rng(1);
  for (int k = 0; k < 2000; ++k) {
    Vector4d q(rng.normal(), rng.normal(), rng.normal(), rng.normal());
    if (k % 4 == 1) q[0] *= 1e-9;  // nearly a half turn
    if (k % 4 == 2) q[0] = 0;
    if (k % 4 == 3) q = {1, 1e-9 * q[1], 1e-9 * q[2], 1e-9 * q[3]};
    q *= (q[0] < 0 ? -1 : 1) / q.norm();
    const Matrix3d r = rotation_of(q);
    EXPECT_TRUE(is_rotation(r, 1e-14));
    const Vector4d back = quaternion_of(r);
    EXPECT_GE(back[0], 0);
    EXPECT_NEAR(back.norm(), 1, 1e-15);
    // At a half rotation, both signs give the same rotation.
    EXPECT_LT(std::min((back - q).norm(), q[0] < 1e-6 ? (back + q).norm() : 1.0), 1e-14);
  }
}

TEST(Rotation, TheAngleIsExactFromNoneToAHalfTurn) {
  EXPECT_EQ(angle_of(Matrix3d::Identity()), 0);
  const Vector3d axis = Vector3d(1, -2, 0.5).normalized();
  for (const double angle : {1e-12, 1e-8, 1e-3, 1.0, kPi / 2, 3.0, kPi - 1e-8, kPi})
    EXPECT_NEAR(angle_of(rotation_by(angle * axis)), angle, 1e-15 + 1e-14 * angle);
  EXPECT_NEAR(angle_of(rotation_by({-0.5, 0, 0})), 0.5, 1e-15);
}

TEST(Rotation, RotationVectorsRoundTrip) {
  const Vector3d axis = Vector3d(0.3, -0.5, 0.8).normalized();
  for (const double angle : {0.0, 1e-9, 1e-4, 0.7, 3.1})
    EXPECT_LT((rotation_vector(rotation_by(angle * axis)) - angle * axis).norm(), 1e-14) << angle;
  EXPECT_NEAR(std::abs(rotation_vector(rotation_by(kPi * axis)).dot(axis)), kPi, 1e-14);
  // A rotation by more than 180 degrees is a smaller rotation in the other direction.
  EXPECT_LT((rotation_vector(rotation_by(4 * axis)) - (4 - 2 * kPi) * axis).norm(), 1e-14);
}

TEST(Rotation, ASmallTurnMovesByTheCrossProduct) {
  const Vector3d x(0.4, -1.2, 2);
  constexpr double kStep = 1e-5;
  for (int axis = 0; axis < 3; ++axis) {
    const Vector3d turn = kStep * Vector3d::Unit(axis);
    const Vector3d numeric = (rotation_by(turn) * x - rotation_by(-turn) * x) / (2 * kStep);
    EXPECT_LT((numeric - Vector3d::Unit(axis).cross(x)).norm(), 1e-9);
  }
}

TEST(Rotation, InterpolatesAtEvenSpeedAlongTheShorterWay) {
  const Matrix3d a = rotation_by({0.3, 0.1, -2});
  const Matrix3d b = rotation_by({0, 1, 0}) * a;
  for (const double part : {0.0, 0.25, 0.5, 1.0})
    EXPECT_LT((interpolate(a, b, part) - rotation_by({0, part, 0}) * a).norm(), 1e-14) << part;
  const Matrix3d far = rotation_by({0, 6, 0}) * a;  // 0.28 in the other direction
  EXPECT_NEAR(angle_of(interpolate(a, far, 0.5) * a.transpose()), kPi - 3, 1e-14);
}

TEST(Rotation, NearestRotationIsALocalOptimum) {
  Rng rng(6);
  for (int k = 0; k < 50; ++k) {
    Matrix3d m;
    for (int c = 0; c < 3; ++c) m.col(c) = random_vector(rng);
    const Matrix3d r = nearest_rotation(m);
    EXPECT_TRUE(is_rotation(r, 1e-12));
    for (int axis = 0; axis < 3; ++axis)
      for (const double turn : {-1e-3, 1e-3, 1.0})
        EXPECT_GE((r.transpose() * m).trace() + 1e-12,
                  ((rotation_by(turn * Vector3d::Unit(axis)) * r).transpose() * m).trace());
    EXPECT_LT((nearest_rotation(3 * r) - r).norm(), 1e-12);
  }
}

TEST(Rotation, InvalidRotationsThrow) {
  EXPECT_THROW((void)rotation_of({0, 0, 0, 0}), std::invalid_argument);
  EXPECT_THROW((void)rotation_of({NAN, 0, 0, 0}), std::invalid_argument);
  EXPECT_THROW((void)quaternion_of(NAN * Matrix3d::Identity()), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::geometry
