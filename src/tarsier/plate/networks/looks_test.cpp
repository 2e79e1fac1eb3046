// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/looks.h"

#include "tarsier/plate/networks/networks.h"
#include "tarsier/plate/text/decode.h"

#include <gtest/gtest.h>

#include <cmath>

namespace tarsier::plate {
namespace {

constexpr int kColumns = kLineWidth / kColumn;

// Blank, except for `symbol` with probability p around column `middle`.
cv::Mat line_with(int middle, int symbol, float p) {
  cv::Mat line(kColumns, kClasses, CV_32F, cv::Scalar(0));
  line.col(kBlank).setTo(1);
  for (int column = middle - 1; column <= middle + 1; ++column) {
    line.at<float>(column, symbol) = p;
    line.at<float>(column, kBlank) = 1 - p;
  }
  return line;
}

TEST(PooledLine, OneLookStaysAsItIs) {
  const cv::Mat line = line_with(10, 3, 0.8F);
  PooledLine pooled(kLineWidth);
  pooled.add(line, {});
  EXPECT_LT(cv::norm(pooled.mean(), line, cv::NORM_INF), 1e-3);
}

TEST(PooledLine, LooksThatDisagreeGiveTheGeometricMean) {
  PooledLine pooled(kLineWidth);
  pooled.add(line_with(10, 3, 0.9F), {});
  pooled.add(line_with(10, 3, 0.4F), {});
  const double in = std::sqrt(0.9 * 0.4);
  const double out = std::sqrt(0.1 * 0.6);
  const cv::Mat mean = pooled.mean();
  EXPECT_NEAR(mean.at<float>(10, 3), in / (in + out), 1e-3);
  EXPECT_NEAR(cv::sum(mean.row(10))[0], 1, 1e-5);
}

// In a wider look, the same character is nearer to the middle.
TEST(PooledLine, AWiderLookIsBroughtToTheColumnsOfTheFirst) {
  const Look wider{1.12F, 1};
  const int first = 6;
  const float place = 0.5F + (along(first, kLineWidth) - 0.5F) / wider.along;
  int there = 0;
  while (along(there + 1, kLineWidth) <= place) ++there;
  EXPECT_GT(there, first);
  PooledLine pooled(kLineWidth);
  pooled.add(line_with(there, 3, 0.9F), wider);
  EXPECT_GT(pooled.mean().at<float>(first, 3), 0.8F);
}

TEST(PooledLine, ColumnsThatANarrowerLookDoesNotReachAreThoseOfTheOthers) {
  PooledLine pooled(kLineWidth);
  pooled.add(line_with(1, 3, 0.9F), {});
  pooled.add(line_with(20, 5, 0.9F), {0.8F, 1});
  const cv::Mat mean = pooled.mean();
  EXPECT_NEAR(mean.at<float>(0, 3), 0.9F, 1e-3F);
}

TEST(PooledLine, RefusesALineOfAnotherWidth) {
  PooledLine pooled(kHalfWidth);
  EXPECT_THROW(pooled.add(line_with(10, 3, 0.9F), {}), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::plate
