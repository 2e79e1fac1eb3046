// SPDX-License-Identifier: MIT
#include "tarsier/sfm/two_view/robust_two_view.h"

#include "tarsier/core/rng.h"
#include "tarsier/geometry/epipolar.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tarsier::sfm {
namespace {

constexpr double kFocal = 1000;  // px

struct SyntheticViews {
  geometry::Rigid3 motion;
  PointPairs rays;
  PointPairs pixels;
  std::vector<char> is_correct;
};

// Points with noise of `noise` px and a share of random outliers. `flat`: all on one plane.
SyntheticViews make_views(std::uint64_t seed, int count, double outliers, double noise,
                          bool flat = false) {
  Rng rng(seed);
  SyntheticViews result;
  result.motion.rotation = geometry::rotation_by(
      {rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3), rng.uniform(-0.3, 0.3)});
  result.motion.translation = Eigen::Vector3d(1, rng.uniform(-0.4, 0.4), 0.2).normalized();
  while (static_cast<int>(result.is_correct.size()) < count) {
    const double x = rng.uniform(-2, 2);
    const double y = rng.uniform(-2, 2);
    const Eigen::Vector3d point(x, y, flat ? 5 + 0.2 * x : rng.uniform(3, 8));
    const Eigen::Vector3d in_second = result.motion * point;
    if (in_second[2] < 1) continue;
    const bool right = rng.uniform() >= outliers;
    Eigen::Vector2d a = point.hnormalized();
    Eigen::Vector2d b = in_second.hnormalized();
    if (!right) b = {rng.uniform(-0.7, 0.7), rng.uniform(-0.7, 0.7)};
    for (int k = 0; k < 2; ++k) {
      a[k] += noise / kFocal * rng.normal();
      b[k] += noise / kFocal * rng.normal();
    }
    result.rays.first.push_back(a);
    result.rays.second.push_back(b);
    result.pixels.first.emplace_back(kFocal * a + Eigen::Vector2d(640, 480));
    result.pixels.second.emplace_back(kFocal * b + Eigen::Vector2d(640, 480));
    result.is_correct.push_back(right ? 1 : 0);
  }
  return result;
}

RobustOptions threshold(double value) {
  RobustOptions options;
  options.threshold = value;
  return options;
}

int agreeing(const std::vector<char>& a, const std::vector<char>& b) {
  int count = 0;
  for (std::size_t i = 0; i < a.size(); ++i) count += (a[i] != 0) == (b[i] != 0) ? 1 : 0;
  return count;
}

TEST(RobustMotion, IsFoundAmongOutliers) {
  for (const double outliers : {0.0, 0.3, 0.6}) {
    for (const std::uint64_t seed : {1U, 2U, 3U}) {
      const SyntheticViews views = make_views(seed, 400, outliers, 0.3);
      const RobustMotion found = robust_motion(views.rays, threshold(1.5 / kFocal));
      ASSERT_EQ(found.is_inlier.size(), 400U);
      EXPECT_LT(
          geometry::angle_of(found.second_from_first.rotation * views.motion.rotation.transpose()),
          0.003);
      EXPECT_LT(std::acos(std::min(
                    1.0, found.second_from_first.translation.dot(views.motion.translation))),
                0.02);
      // Some outliers lie near the epipolar line by chance.
      EXPECT_GT(agreeing(found.is_inlier, views.is_correct), 385);
    }
  }
}

TEST(RobustMotion, RankingFindsFewInliersAmongMany) {
  // One of ten is an inlier. 5 inliers are drawn once in 100 000 times, but inliers have the better
  // order.
  const SyntheticViews views = make_views(7, 600, 0.9, 0.3);
  PointPairs pairs = views.rays;
  pairs.order.resize(600);
  std::iota(pairs.order.begin(), pairs.order.end(), 0);
  Rng rng(1);
  std::vector<double> ranking(600);
  for (std::size_t i = 0; i < 600; ++i)
    ranking[i] = rng.uniform() + (views.is_correct[i] != 0 ? 0.6 : 0);
  std::sort(pairs.order.begin(), pairs.order.end(), [&](int a, int b) {
    return ranking[static_cast<std::size_t>(a)] > ranking[static_cast<std::size_t>(b)];
  });
  const RobustMotion found = robust_motion(pairs, threshold(1.5 / kFocal));
  EXPECT_LT(
      geometry::angle_of(found.second_from_first.rotation * views.motion.rotation.transpose()),
      0.01);
}

TEST(RobustMotion, IsDeterministicForSeed) {
  const SyntheticViews views = make_views(5, 200, 0.5, 0.5);
  const RobustMotion a = robust_motion(views.rays, threshold(1.5 / kFocal));
  const RobustMotion b = robust_motion(views.rays, threshold(1.5 / kFocal));
  EXPECT_EQ(a.second_from_first.rotation, b.second_from_first.rotation);
  EXPECT_EQ(a.is_inlier, b.is_inlier);
}

TEST(RobustFundamental, FindsInliers) {
  for (const double outliers : {0.0, 0.5}) {
    const SyntheticViews views = make_views(11, 300, outliers, 0.3);
    const RobustMatrix found = robust_fundamental(views.pixels, threshold(1.5));
    ASSERT_EQ(found.is_inlier.size(), 300U);
    EXPECT_GT(agreeing(found.is_inlier, views.is_correct), 288) << outliers;
    EXPECT_LT(std::abs(found.matrix.determinant()), 1e-9);
  }
}

TEST(RobustHomography, FindsInliersOfPlane) {
  const SyntheticViews views = make_views(12, 300, 0.4, 0.3, true);
  const RobustMatrix found = robust_homography(views.pixels, threshold(3));
  ASSERT_EQ(found.is_inlier.size(), 300U);
  EXPECT_GT(agreeing(found.is_inlier, views.is_correct), 297);
}

TEST(RobustTwoView, ToleratesTooFewAndIdenticalPairs) {
  PointPairs pairs;
  EXPECT_EQ(robust_motion(pairs, threshold(1)).inliers, 0);
  EXPECT_EQ(robust_fundamental(pairs, threshold(1)).inliers, 0);
  EXPECT_EQ(robust_homography(pairs, threshold(1)).inliers, 0);
  pairs.first.assign(30, Eigen::Vector2d(0.1, 0.2));
  pairs.second = pairs.first;
  const RobustMotion motion = robust_motion(pairs, threshold(0.001));
  EXPECT_TRUE(motion.second_from_first.translation.allFinite());
  EXPECT_EQ(robust_homography(pairs, threshold(0.001)).inliers, 0);
  pairs.second.pop_back();
  EXPECT_THROW((void)robust_motion(pairs, threshold(1)), std::invalid_argument);
}

// Points near a plane that fills both images. Most of them are inliers of the plane's second motion
// too.
TEST(RobustMotion, IsCorrectForNearlyPlanarPoints) {
  int wrong = 0;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    Rng rng(seed);
    geometry::Rigid3 motion;
    motion.rotation = geometry::rotation_by({0, rng.uniform(-0.2, 0.2), 0});
    motion.translation = motion.rotation * Eigen::Vector3d(-2.5, 0, 0);
    PointPairs rays;
    while (rays.first.size() < 150) {
      const Eigen::Vector3d point(rng.uniform(-6, 6), rng.uniform(-4, 4),
                                  8 + rng.uniform(-0.8, 0.8));
      const Eigen::Vector3d in_second = motion * point;
      if (std::abs(in_second[0]) > 0.64 * in_second[2]) continue;
      const auto noise = [&]() -> Eigen::Vector2d {
        const double x = rng.normal();
        const double y = rng.normal();
        return {x / kFocal, y / kFocal};
      };
      const Eigen::Vector2d at_first = noise();
      rays.first.push_back(point.hnormalized() + at_first);
      rays.second.push_back(in_second.hnormalized() + noise());
    }
    RobustOptions options = threshold(3 / kFocal);
    options.seed = seed;
    const RobustMotion found = robust_motion(rays, options);
    const double error =
        geometry::angle_of(found.second_from_first.rotation * motion.rotation.transpose());
    wrong += error > 0.05 ? 1 : 0;
  }
  EXPECT_LE(wrong, 3);
}

}  // namespace
}  // namespace tarsier::sfm
