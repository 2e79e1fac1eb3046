// SPDX-License-Identifier: MIT
#include "tarsier/geometry/epipolar.h"

#include "tarsier/core/rng.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace tarsier::geometry {
namespace {

struct TwoViews {
  Rigid3 motion;
  std::vector<Eigen::Vector2d> first;
  std::vector<Eigen::Vector2d> second;
};

TwoViews random_views(Rng& rng, int count) {
  TwoViews views;
  Eigen::Vector3d turn;
  for (int k = 0; k < 3; ++k) turn[k] = rng.uniform(-0.5, 0.5);
  for (int k = 0; k < 3; ++k) views.motion.translation[k] = rng.uniform(-1, 1);
  views.motion.translation.normalize();
  views.motion.rotation = rotation_by(turn);
  while (static_cast<int>(views.first.size()) < count) {
    const double x = rng.uniform(-2, 2);
    const double y = rng.uniform(-2, 2);
    const Eigen::Vector3d point(x, y, rng.uniform(3, 8));
    const Eigen::Vector3d other = views.motion * point;
    if (other[2] < 1) continue;
    views.first.push_back(point.hnormalized());
    views.second.push_back(other.hnormalized());
  }
  return views;
}

template <std::size_t N>
std::array<Eigen::Vector2d, N> first_of(const std::vector<Eigen::Vector2d>& all) {
  std::array<Eigen::Vector2d, N> result;
  std::copy_n(all.begin(), N, result.begin());
  return result;
}

double matrix_distance(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b) {
  const Eigen::Matrix3d x = a / a.norm();
  const Eigen::Matrix3d y = b / b.norm();
  return std::min((x - y).norm(), (x + y).norm());
}

TEST(FivePoint, FindsTheMotionOfExactPoints) {
  Rng rng(3);
  int found = 0;
  for (int round = 0; round < 200; ++round) {
    const TwoViews views = random_views(rng, 5);
    std::array<Eigen::Matrix3d, kMaxEssentials> essentials;
    const auto a = first_of<5>(views.first);
    const auto b = first_of<5>(views.second);
    const int count = five_point(a, b, essentials);
    double nearest = 1;
    for (int k = 0; k < count; ++k) {
      const Eigen::Matrix3d& e = essentials[static_cast<std::size_t>(k)];
      nearest = std::min(nearest, matrix_distance(e, essential_of(views.motion)));
      // Every solution is an essential matrix that fits the points.
      EXPECT_LT(std::abs(e.determinant()), 1e-6);
      EXPECT_LT((2 * e * e.transpose() * e - (e * e.transpose()).trace() * e).norm(), 1e-5);
      for (std::size_t i = 0; i < 5; ++i)
        EXPECT_LT(std::abs(b[i].homogeneous().dot(e * a[i].homogeneous())), 1e-9);
    }
    found += nearest < 1e-6 ? 1 : 0;
  }
  EXPECT_GE(found, 197);  // roots beyond 100 are not searched
}

TEST(FivePoint, IdenticalPointsGiveNoOrFiniteMatrices) {
  std::array<Eigen::Vector2d, 5> same;
  same.fill({0.1, 0.2});
  std::array<Eigen::Matrix3d, kMaxEssentials> essentials;
  const int count = five_point(same, same, essentials);
  for (int k = 0; k < count; ++k) EXPECT_TRUE(essentials[static_cast<std::size_t>(k)].allFinite());
  same[2][0] = std::nan("");
  EXPECT_EQ(five_point(same, same, essentials), 0);
}

TEST(SevenPoint, FindsTheMatrixOfExactPoints) {
  Rng rng(4);
  for (int round = 0; round < 100; ++round) {
    const TwoViews views = random_views(rng, 7);
    std::array<Eigen::Matrix3d, kMaxFundamentals> found;
    const int count = seven_point(first_of<7>(views.first), first_of<7>(views.second), found);
    double nearest = 1;
    for (int k = 0; k < count; ++k)
      nearest = std::min(
          nearest, matrix_distance(found[static_cast<std::size_t>(k)], essential_of(views.motion)));
    EXPECT_LT(nearest, 1e-6) << round;
  }
}

TEST(FourPoint, MapsFourPointsToFourOthers) {
  const std::array<Eigen::Vector2d, 4> a{{{0, 0}, {1, 0}, {1.2, 1}, {0, 1}}};
  const std::array<Eigen::Vector2d, 4> b{{{5, 5}, {9, 6}, {8, 9}, {4, 8}}};
  Eigen::Matrix3d h;
  ASSERT_TRUE(four_point(a, b, h));
  for (std::size_t i = 0; i < 4; ++i)
    EXPECT_LT(((h * a[i].homogeneous()).hnormalized() - b[i]).norm(), 1e-9);
  const std::array<Eigen::Vector2d, 4> line{{{0, 0}, {1, 1}, {2, 2}, {0, 1}}};
  EXPECT_FALSE(four_point(line, b, h));
  EXPECT_FALSE(four_point(a, line, h));
}

TEST(MotionsOf, ContainTheTrueMotion) {
  Rng rng(5);
  const TwoViews views = random_views(rng, 1);
  double nearest = 10;
  for (const Rigid3& motion : motions_of(-3 * essential_of(views.motion))) {
    EXPECT_TRUE(is_rotation(motion.rotation));
    nearest = std::min(nearest, (motion.rotation - views.motion.rotation).norm() +
                                    (motion.translation - views.motion.translation).norm());
  }
  EXPECT_LT(nearest, 1e-9);
}

TEST(RealRoots, AreFoundInOrderAndCountOnce) {
  // (z + 2)(z - 0.5)^2 (z - 3)(z2 + 1)
  std::array<double, 6> roots{};
  std::array<double, 7> product{1};
  int degree = 0;
  const auto times = [&](double constant, double linear) {
    for (int k = ++degree; k >= 0; --k) {
      const auto at = static_cast<std::size_t>(k);
      product[at] = constant * product[at] + (k > 0 ? linear * product[at - 1] : 0);
    }
  };
  for (const double root : {-2.0, 0.5, 0.5, 3.0}) times(-root, 1);
  for (std::size_t k = 7; k-- > 2;) product[k] += product[k - 2];  // times z2 + 1
  ASSERT_EQ(real_roots(product, -10, 10, roots), 3);
  EXPECT_NEAR(roots[0], -2, 1e-9);
  EXPECT_NEAR(roots[1], 0.5, 1e-5);
  EXPECT_NEAR(roots[2], 3, 1e-9);
  EXPECT_EQ(real_roots(product, -1, 1, roots), 1);
  EXPECT_EQ(real_roots(std::array<double, 3>{1, 0, 1}, -10, 10, roots), 0);
  EXPECT_EQ(real_roots(std::array<double, 3>{0, 0, 0}, -10, 10, roots), 0);
}

}  // namespace
}  // namespace tarsier::geometry
