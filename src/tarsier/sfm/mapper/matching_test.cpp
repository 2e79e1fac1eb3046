// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/matching.h"

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

// Straight from the definition.
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

TEST(MatchFeatures, IsWhatTheDefinitionSays) {
  for (const FeatureKind kind : {FeatureKind::kSift, FeatureKind::kOrb}) {
    const int columns = kind == FeatureKind::kSift ? 128 : 32;
    cv::Mat a = random_descriptors(150, columns, 1);
    cv::Mat b = random_descriptors(131, columns, 2);
    Rng rng(3);
    for (int r = 0; r < 60; ++r) {  // some that belong together, more or less alike
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

TEST(MatchFeatures, NothingMatchesNothing) {
  const cv::Mat some = random_descriptors(5, 128, 1);
  EXPECT_TRUE(match_features({}, some, FeatureKind::kSift, {}).empty());
  EXPECT_TRUE(match_features(some, {}, FeatureKind::kSift, {}).empty());
  EXPECT_THROW((void)match_features(some, random_descriptors(5, 32, 1), FeatureKind::kSift, {}),
               std::invalid_argument);
}

TEST(MatchFeatures, TheSameTwiceIsNoMatch) {
  // Repeated texture: the second nearest is as near as the nearest.
  cv::Mat a = random_descriptors(4, 128, 5);
  cv::Mat b;
  b.push_back(a);
  b.push_back(a);
  EXPECT_TRUE(match_features(a, b, FeatureKind::kSift, {}).empty());
}

TEST(Similarity, IsOneForEqualAndLessForOthers) {
  const cv::Mat a = random_descriptors(2, 128, 1);
  EXPECT_NEAR(similarity(a, 0, a, 0, FeatureKind::kSift), 1, 1e-9);
  EXPECT_LT(similarity(a, 0, a, 1, FeatureKind::kSift), 0.95);
  EXPECT_NEAR(similarity(a, 0, a, 0, FeatureKind::kOrb), 1, 1e-9);
}

}  // namespace
}  // namespace tarsier::sfm
