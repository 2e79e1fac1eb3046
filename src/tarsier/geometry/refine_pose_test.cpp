// SPDX-License-Identifier: MIT
#include "tarsier/geometry/refine_pose.h"

#include <gtest/gtest.h>

#include <limits>
#include <vector>

namespace tarsier::geometry {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

// Points in space and their positions after a true pose. Residuals are distances in space.
struct Cloud {
  std::vector<Vector3d> points{{0, 0, 0}, {1, 0, 0}, {0, 2, 0}, {0, 0, 3}, {-1, 2, 1}};
  Matrix3d rotation = Eigen::AngleAxisd(0.9, Vector3d(1, 2, -1).normalized()).toRotationMatrix();
  Vector3d translation{0.5, -1, 4};

  [[nodiscard]] double cost(const Matrix3d& r, const Vector3d& t) const {
    double sum = 0;
    for (const Vector3d& p : points) sum += (r * p + t - rotation * p - translation).squaredNorm();
    return sum;
  }
  [[nodiscard]] PoseEquations equations(const Matrix3d& r, const Vector3d& t) const {
    PoseEquations sums;
    for (const Vector3d& p : points) {
      const Vector3d q = r * p;
      Eigen::Matrix<double, 3, 6> jacobian;
      jacobian << 0, q.z(), -q.y(), 1, 0, 0, -q.z(), 0, q.x(), 0, 1, 0, q.y(), -q.x(), 0, 0, 0, 1;
      sums.normal += jacobian.transpose() * jacobian;
      sums.gradient += jacobian.transpose() * (q + t - rotation * p - translation);
    }
    return sums;
  }
};

RefinedPose refined(const Cloud& cloud, Matrix3d& rotation, Vector3d& translation,
                    const RefinePoseOptions& options) {
  return refine_pose(
      rotation, translation, [&](const auto& r, const auto& t) { return cloud.cost(r, t); },
      [&](const auto& r, const auto& t) { return cloud.equations(r, t); }, options);
}

TEST(RefinePose, FindsThePoseWithAndWithoutDamping) {
  const Cloud cloud;
  for (const double damping : {0.0, 1e-4, 1.0}) {
    Matrix3d rotation = Matrix3d::Identity();
    Vector3d translation = Vector3d::Zero();
    const RefinedPose result = refined(cloud, rotation, translation,
                                       {.max_steps = 60, .damping = damping, .tolerance = 1e-12});
    EXPECT_LT(result.cost, 1e-12) << damping;
    EXPECT_LT((rotation - cloud.rotation).norm(), 1e-6) << damping;
    EXPECT_LT((translation - cloud.translation).norm(), 1e-6) << damping;
    EXPECT_LT((rotation * rotation.transpose() - Matrix3d::Identity()).norm(), 1e-12);
  }
}

TEST(RefinePose, ZeroStepsReturnTheInitialCost) {
  const Cloud cloud;
  Matrix3d rotation = Matrix3d::Identity();
  Vector3d translation = Vector3d::Zero();
  const RefinedPose result = refined(cloud, rotation, translation, {.max_steps = 0});
  EXPECT_EQ(result.cost, cloud.cost(Matrix3d::Identity(), Vector3d::Zero()));
  EXPECT_FALSE(result.converged);
  EXPECT_EQ(rotation, Matrix3d::Identity());
}

TEST(RefinePose, RespectsTheMaximumNumberOfTrials) {
  const Cloud cloud;
  int tried = -1;  // no step was tried at the start
  Matrix3d rotation = Matrix3d::Identity();
  Vector3d translation = Vector3d::Zero();
  const auto finite_only_at_start = [&](const Matrix3d& r, const Vector3d& t) {
    return ++tried > 0 ? std::numeric_limits<double>::infinity() : cloud.cost(r, t);
  };
  const auto equations = [&](const Matrix3d& r, const Vector3d& t) {
    return cloud.equations(r, t);
  };
  (void)refine_pose(rotation, translation, finite_only_at_start, equations,
                    {.max_steps = 9, .max_trials = 4});
  EXPECT_EQ(tried, 4);
  EXPECT_EQ(rotation, Matrix3d::Identity());
  // Also steps that lower the cost count.
  int better = -1;
  const auto counted = [&](const Matrix3d& r, const Vector3d& t) {
    ++better;
    return cloud.cost(r, t);
  };
  (void)refine_pose(rotation, translation, counted, equations,
                    {.max_steps = 9, .max_trials = 2, .damping = 1});
  EXPECT_EQ(better, 2);
}

// Steps to invalid values are refused. A start with invalid values is not changed.
TEST(RefinePose, KeepsAPoseThatNoStepImproves) {
  const Cloud cloud;
  Matrix3d rotation = cloud.rotation;
  Vector3d translation = cloud.translation + Vector3d(0, 0, 1);
  const auto forbidden = [&](const Matrix3d& r, const Vector3d& t) {
    return t.z() < 4.9 ? std::numeric_limits<double>::infinity() : cloud.cost(r, t);
  };
  const auto equations = [&](const Matrix3d& r, const Vector3d& t) {
    return cloud.equations(r, t);
  };
  const double before = forbidden(rotation, translation);
  const RefinedPose result =
      refine_pose(rotation, translation, forbidden, equations, {.max_steps = 20});
  EXPECT_LE(result.cost, before);
  EXPECT_GE(translation.z(), 4.9);
  EXPECT_TRUE(result.converged);
  translation.z() = 0;
  EXPECT_FALSE(std::isfinite(
      refine_pose(rotation, translation, forbidden, equations, {.max_steps = 20}).cost));
}

}  // namespace
}  // namespace tarsier::geometry
