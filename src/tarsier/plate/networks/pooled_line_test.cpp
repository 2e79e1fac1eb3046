// SPDX-License-Identifier: MIT
#include "tarsier/plate/networks/pooled_line.h"

#include "tarsier/plate/networks/networks.h"
#include "tarsier/plate/text/decode.h"

#include <gtest/gtest.h>

#include <cmath>

namespace tarsier::plate {
namespace {

constexpr int kColumns = kLineWidth / kColumnStride;

// Blank, except for `symbol` with probability p around column `center`.
cv::Mat line_with(int center, int symbol, float p) {
  cv::Mat line(kColumns, kClasses, CV_32F, cv::Scalar(0));
  line.col(kBlank).setTo(1);
  for (int column = center - 1; column <= center + 1; ++column) {
    line.at<float>(column, symbol) = p;
    line.at<float>(column, kBlank) = 1 - p;
  }
  return line;
}

TEST(PooledLine, SingleViewIsUnchanged) {
  const cv::Mat line = line_with(10, 3, 0.8F);
  PooledLine pooled(kLineWidth);
  pooled.add(line, {});
  EXPECT_LT(cv::norm(pooled.mean(), line, cv::NORM_INF), 1e-3);
}

TEST(PooledLine, DisagreeingViewsGiveTheGeometricMean) {
  PooledLine pooled(kLineWidth);
  pooled.add(line_with(10, 3, 0.9F), {});
  pooled.add(line_with(10, 3, 0.4F), {});
  const double in = std::sqrt(0.9 * 0.4);
  const double out = std::sqrt(0.1 * 0.6);
  const cv::Mat mean = pooled.mean();
  EXPECT_NEAR(mean.at<float>(10, 3), in / (in + out), 1e-3);
  EXPECT_NEAR(cv::sum(mean.row(10))[0], 1, 1e-5);
}

// In a wider view, the same character is nearer to the centre.
TEST(PooledLine, WiderViewIsResampledToTheColumnsOfTheText) {
  const TextView wider{1.12F, 1};
  const int first = 6;
  const float position = 0.5F + (along(first, kLineWidth) - 0.5F) / wider.along;
  int column = 0;
  while (along(column + 1, kLineWidth) <= position) ++column;
  EXPECT_GT(column, first);
  PooledLine pooled(kLineWidth);
  pooled.add(line_with(column, 3, 0.9F), wider);
  EXPECT_GT(pooled.mean().at<float>(first, 3), 0.8F);
}

TEST(PooledLine, ColumnsOutsideANarrowViewComeFromTheOthers) {
  PooledLine pooled(kLineWidth);
  pooled.add(line_with(1, 3, 0.9F), {});
  pooled.add(line_with(20, 5, 0.9F), {0.8F, 1});
  const cv::Mat mean = pooled.mean();
  EXPECT_NEAR(mean.at<float>(0, 3), 0.9F, 1e-3F);
}

TEST(PooledLine, RejectsALineOfAnotherWidth) {
  PooledLine pooled(kHalfLineWidth);
  EXPECT_THROW(pooled.add(line_with(10, 3, 0.9F), {}), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::plate
