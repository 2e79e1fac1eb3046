// SPDX-License-Identifier: MIT
#include "tarsier/geometry/sim3.h"

#include "tarsier/core/rng.h"
#include "tarsier/geometry/testing_vectors.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

namespace tarsier::geometry {
namespace {

using Eigen::Matrix3Xd;
using Eigen::Vector3d;

Sim3 random_similarity(Rng& rng) {
  return {std::exp(rng.normal()), rotation_by(random_vector(rng)), random_vector(rng)};
}

Matrix3Xd cloud(Rng& rng, int count) {
  Matrix3Xd points(3, count);
  for (int i = 0; i < count; ++i) points.col(i) = random_vector(rng);
  return points;
}

Matrix3Xd moved(const Sim3& by, const Matrix3Xd& points) {
  Matrix3Xd result(3, points.cols());
  for (Eigen::Index i = 0; i < points.cols(); ++i) result.col(i) = by * points.col(i);
  return result;
}

void expect_same(const Sim3& a, const Sim3& b, double tolerance) {
  EXPECT_NEAR(a.scale / b.scale, 1, tolerance);
  EXPECT_LT((a.rotation - b.rotation).norm(), tolerance);
  EXPECT_LT((a.translation - b.translation).norm(), tolerance * (1 + b.translation.norm()));
}

TEST(Sim3Test, IsAGroup) {
  Rng rng(1);
  for (int k = 0; k < 100; ++k) {
    const Sim3 a = random_similarity(rng);
    const Sim3 b = random_similarity(rng);
    const Sim3 c = random_similarity(rng);
    const Vector3d x = random_vector(rng);
    expect_same((a * b) * c, a * (b * c), 1e-12);
    expect_same(a * a.inverse(), {}, 1e-12);
    expect_same((a * b).inverse(), b.inverse() * a.inverse(), 1e-12);
    EXPECT_LT(((a * b) * x - a * (b * x)).norm(), 1e-12 * (1 + (a * (b * x)).norm()));
    EXPECT_LT((a.inverse() * (a * x) - x).norm(), 1e-12);
    EXPECT_NO_THROW((a * b).check());
  }
}

TEST(Sim3Test, AMovedCameraSeesTheMovedPointsWhereItSawThem) {
  Rng rng(2);
  const Rigid3 camera{rotation_by(random_vector(rng)), random_vector(rng)};
  const Sim3 by = random_similarity(rng);
  const Rigid3 there = moved_camera(camera, by);
  for (int k = 0; k < 20; ++k) {
    const Vector3d x = random_vector(rng);
    EXPECT_LT((there * (by * x) - by.scale * (camera * x)).norm(), 1e-13);
  }
  EXPECT_LT((there.center() - by * camera.center()).norm(), 1e-13);
}

TEST(Sim3Test, IsFoundFromPoints) {
  Rng rng(3);
  for (const int count : {3, 4, 50}) {
    const Matrix3Xd from = cloud(rng, count);
    const Sim3 truth = random_similarity(rng);
    const auto found = similarity_between(from, moved(truth, from));
    ASSERT_TRUE(found);
    expect_same(*found, truth, 1e-9);
  }
}

// The min of the sum of squares: no neighbouring similarity has a lower sum.
TEST(Sim3Test, IsOptimalUnderNoise) {
  Rng rng(4);
  const Matrix3Xd from = cloud(rng, 12);
  const Matrix3Xd to = moved(random_similarity(rng), from) + 0.1 * cloud(rng, 12);
  const Sim3 found = similarity_between(from, to).value();
  const auto cost = [&](const Sim3& s) { return (moved(s, from) - to).squaredNorm(); };
  for (int axis = 0; axis < 3; ++axis) {
    for (const double step : {-1e-3, 1e-3}) {
      Sim3 other = found;
      other.translation[axis] += step;
      EXPECT_GT(cost(other), cost(found));
      other = found;
      other.rotation = rotation_by(step * Vector3d::Unit(axis)) * found.rotation;
      other.translation =
          to.rowwise().mean() - other.scale * (other.rotation * from.rowwise().mean());
      EXPECT_GT(cost(other), cost(found));
      other = found;
      other.scale += step;
      EXPECT_GT(cost(other), cost(found));
    }
  }
}

TEST(Sim3Test, DegeneratePointsHaveNoSimilarity) {
  Rng rng(5);
  Matrix3Xd line(3, 5);
  for (int i = 0; i < 5; ++i) line.col(i) = i * Vector3d(1, 2, 3);
  const Matrix3Xd spread = cloud(rng, 5);
  EXPECT_FALSE(similarity_between(line, spread));
  EXPECT_FALSE(similarity_between(spread, line));
  EXPECT_FALSE(similarity_between(cloud(rng, 2), cloud(rng, 2)));
  EXPECT_THROW((void)similarity_between(line, cloud(rng, 4)), std::invalid_argument);
  EXPECT_THROW((void)similarity_between(NAN * line, spread), std::invalid_argument);
}

TEST(Sim3Test, CheckRefusesInvalidSimilarities) {
  EXPECT_NO_THROW(Sim3{}.check());
  EXPECT_THROW((Sim3{.scale = 0}.check()), std::invalid_argument);
  EXPECT_THROW((Sim3{.scale = INFINITY}.check()), std::invalid_argument);
  EXPECT_THROW((Sim3{.rotation = -Eigen::Matrix3d::Identity()}.check()), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::geometry
