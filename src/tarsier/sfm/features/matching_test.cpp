// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/matching.h"

#include "tarsier/core/rng.h"

#include <gtest/gtest.h>

#include <cmath>

namespace tarsier::sfm {
namespace {

cv::Mat random_descriptors(int rows, int columns, std::uint64_t seed) {
  cv::Mat result(rows, columns, CV_8UC1);
  Rng rng(seed);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < columns; ++c)
      result.at<std::uint8_t>(r, c) = static_cast<std::uint8_t>(rng.integer(0, 90));
  return result;
}

// The direct definition.
std::vector<Match> reference(const cv::Mat& a, const cv::Mat& b, FeatureKind kind, double ratio) {
  const auto distance = [&](int i, int j) {
    double sum = 0;
    for (int k = 0; k < a.cols; ++k) {
      const int x = a.at<std::uint8_t>(i, k);
      const int y = b.at<std::uint8_t>(j, k);
      if (kind == FeatureKind::kSift) {
        sum += (x - y) * (x - y);
      } else {
        for (int bit = 0; bit < 8; ++bit) sum += ((x ^ y) >> bit) & 1;
      }
    }
    return kind == FeatureKind::kSift ? std::sqrt(sum) : sum;
  };
  std::vector<Match> matches;
  for (int i = 0; i < a.rows; ++i) {
    double best = 1e18;
    double second = 1e18;
    int index = -1;
    for (int j = 0; j < b.rows; ++j) {
      const double d = distance(i, j);
      if (d < best) {
        second = best;
        best = d;
        index = j;
      } else {
        second = std::min(second, d);
      }
    }
    bool mutual = index >= 0;
    for (int k = 0; k < a.rows && mutual; ++k)
      mutual = k == i || distance(k, index) > best || (distance(k, index) == best && k > i);
    if (mutual && best < ratio * second) matches.push_back({i, index});
  }
  return matches;
}

TEST(MatchFeatures, EqualsReferenceImplementation) {
  for (const FeatureKind kind : {FeatureKind::kSift, FeatureKind::kOrb}) {
    const int columns = kind == FeatureKind::kSift ? 128 : 32;
    cv::Mat a = random_descriptors(150, columns, 1);
    cv::Mat b = random_descriptors(131, columns, 2);
    Rng rng(3);
    for (int r = 0; r < 60; ++r) {  // some pairs of rows that match, with different distances
      for (int c = 0; c < columns; ++c) {
        const int noise = kind == FeatureKind::kSift ? rng.integer(-r / 4, r / 4)
                                                     : (rng.uniform() < r * 0.003 ? 1 : 0);
        b.at<std::uint8_t>(130 - r, c) =
            cv::saturate_cast<std::uint8_t>(a.at<std::uint8_t>(r * 2, c) + noise);
      }
    }
    const std::vector<Match> expected = reference(a, b, kind, 0.8);
    EXPECT_GT(expected.size(), 40U);
    EXPECT_EQ(match_features(a, b, kind, {}), expected);
  }
}

TEST(MatchFeatures, IsEmptyWithoutDescriptors) {
  const cv::Mat some = random_descriptors(5, 128, 1);
  EXPECT_TRUE(match_features({}, some, FeatureKind::kSift, {}).empty());
  EXPECT_TRUE(match_features(some, {}, FeatureKind::kSift, {}).empty());
  EXPECT_THROW((void)match_features(some, random_descriptors(5, 32, 1), FeatureKind::kSift, {}),
               std::invalid_argument);
}

TEST(MatchFeatures, RejectsRepeatedDescriptors) {
  // Repeated texture: the second nearest is as near as the nearest.
  cv::Mat a = random_descriptors(4, 128, 5);
  cv::Mat b;
  b.push_back(a);
  b.push_back(a);
  EXPECT_TRUE(match_features(a, b, FeatureKind::kSift, {}).empty());
}

// Features at these positions. The last descriptors are additional ones of the points in `owners`.
Features features_at(const std::vector<cv::Point2f>& points, const cv::Mat& descriptors,
                     const std::vector<std::int32_t>& owners) {
  Features features;
  features.points = points;
  features.descriptors = descriptors;
  features.owners = owners;
  return features;
}

TEST(MatchFeatures, RatioTestIgnoresDescriptorsOfSamePoint) {
  // Three points. Two have an additional descriptor that is nearly equal to the first.
  const cv::Mat one = random_descriptors(3, 128, 11);
  cv::Mat rows;
  rows.push_back(one);
  rows.push_back(one.rowRange(0, 2));
  for (int r = 3; r < rows.rows; ++r) rows.at<std::uint8_t>(r, 100) += 3;
  cv::Mat noisy = rows.clone();
  for (int r = 0; r < noisy.rows; ++r) noisy.at<std::uint8_t>(r, 3 * r) += 9;
  const Features a = features_at({{1, 1}, {5, 1}, {9, 1}}, rows, {0, 1});
  const Features b = features_at({{2, 2}, {6, 2}, {9, 2}}, noisy, {0, 1});
  // In a match row by row, the second descriptor of a point is nearly as near as the first.
  EXPECT_EQ(match_features(a.descriptors, b.descriptors, FeatureKind::kSift, {}),
            (std::vector<Match>{{2, 2}}));
  std::vector<float> ratios;
  EXPECT_EQ(match_features(a, b, FeatureKind::kSift, {}, &ratios),
            (std::vector<Match>{{0, 0}, {1, 1}, {2, 2}}));
  ASSERT_EQ(ratios.size(), 3U);
  for (const float ratio : ratios) EXPECT_LT(ratio, 0.64F);
}

TEST(MatchFeatures, AdditionalDescriptorMatchesItsPoint) {
  const cv::Mat one = random_descriptors(6, 128, 12);
  const auto rows = [&](std::initializer_list<int> which) {
    cv::Mat result;
    for (const int row : which) result.push_back(one.row(row));
    return result;
  };
  // Point 1 of the two images matches only by its second descriptor.
  const Features a = features_at({{1, 1}, {5, 1}}, rows({0, 1, 4}), {1});
  const Features b = features_at({{2, 2}, {6, 2}}, rows({2, 3, 4}), {1});
  EXPECT_EQ(match_features(a, b, FeatureKind::kSift, {}), (std::vector<Match>{{1, 1}}));
  // Points at the same position count as the first of them. If two points match it, the nearer one
  // is kept.
  const Features c = features_at({{1, 1}, {1, 1}, {7, 7}}, rows({0, 1, 2, 5}), {2});
  cv::Mat noisy = rows({1, 0, 2});
  noisy.at<std::uint8_t>(0, 0) += 3;
  const Features d = features_at({{3, 3}, {4, 4}, {8, 8}}, noisy, {});
  EXPECT_EQ(match_features(c, d, FeatureKind::kSift, {}), (std::vector<Match>{{0, 1}, {2, 2}}));
}

TEST(MatchFeatures, WithoutAdditionalDescriptorsEqualsDescriptorMatching) {
  const cv::Mat a = random_descriptors(40, 128, 6);
  cv::Mat b = random_descriptors(50, 128, 7);
  a.rowRange(0, 20).copyTo(b.rowRange(10, 30));
  const std::vector<cv::Point2f> at_a(40, cv::Point2f(1, 1));
  const std::vector<cv::Point2f> at_b(50, cv::Point2f(1, 1));
  EXPECT_EQ(
      match_features(features_at(at_a, a, {}), features_at(at_b, b, {}), FeatureKind::kSift, {}),
      match_features(a, b, FeatureKind::kSift, {}));
}

TEST(Similarity, IsOneForEqualDescriptorsOnly) {
  const cv::Mat a = random_descriptors(2, 128, 1);
  EXPECT_NEAR(similarity(a, 0, a, 0, FeatureKind::kSift), 1, 1e-9);
  EXPECT_LT(similarity(a, 0, a, 1, FeatureKind::kSift), 0.95);
  EXPECT_NEAR(similarity(a, 0, a, 0, FeatureKind::kOrb), 1, 1e-9);
}

}  // namespace
}  // namespace tarsier::sfm
