// SPDX-License-Identifier: MIT
#include "tarsier/face/people/quality.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cmath>

namespace tarsier::face::people {
namespace {

using ::testing::Contains;
using ::testing::IsEmpty;

const Eyes kEyes{{60, 60}, {110, 60}};

// Symmetric, of medium brightness, with fine detail.
cv::Mat pattern() {
  cv::Mat half(160, 64, CV_8UC1);
  cv::RNG rng(5);
  rng.fill(half, cv::RNG::NORMAL, 128, 60);
  cv::GaussianBlur(half, half, {}, 2);
  half.convertTo(half, CV_32F, 3, -256);
  for (int y = 0; y < half.rows; ++y)  // coarse detail that a blur keeps
    half.row(y) += 25 * std::sin(y / 12.0);
  half.convertTo(half, CV_8U);
  cv::Mat mirrored;
  cv::flip(half, mirrored, 1);
  cv::Mat out;
  cv::hconcat(half, mirrored, out);
  return out;
}

Eigen::Matrix2Xd points(double nose_x, double nose_y) {
  Eigen::Matrix2Xd p = Eigen::Matrix2Xd::Zero(2, 68);
  for (int i = 36; i < 42; ++i) p.col(i) << 60, 60;
  for (int i = 42; i < 48; ++i) p.col(i) << 110, 60;
  for (int i = 30; i < 36; ++i) p.col(i) << nose_x, nose_y;
  return p;
}

TEST(QualityTest, GoodFaceHasNoProblems) {
  const Quality q = measure_quality(pattern(), kEyes, points(85, 60 + 0.67 * 50));
  EXPECT_THAT(quality_problems(q, {}), IsEmpty());
  EXPECT_NEAR(q.turn, 0, 1e-9);
  EXPECT_NEAR(q.tilt, 0, 1e-9);
  EXPECT_GT(q.score(), 0.5);
}

TEST(QualityTest, NamesEachProblem) {
  const QualityGate gate;
  const auto p = points(85, 93.5);
  const auto problems_of = [&](const cv::Mat& crop, const Eyes& eyes, const Eigen::Matrix2Xd& at) {
    return quality_problems(measure_quality(crop, eyes, at), gate);
  };
  EXPECT_THAT(problems_of(pattern(), {{60, 60}, {70, 60}}, {}), Contains("too small"));
  cv::Mat blurred;
  cv::GaussianBlur(pattern(), blurred, {}, 8);
  EXPECT_THAT(problems_of(blurred, kEyes, p), Contains("blurred"));
  EXPECT_THAT(problems_of(pattern(), kEyes, points(108, 93.5)), Contains("turned away"));
  EXPECT_THAT(problems_of(pattern(), kEyes, points(85, 70)), Contains("tilted up"));
  EXPECT_THAT(problems_of(pattern(), kEyes, points(85, 115)), Contains("tilted down"));
  EXPECT_THAT(problems_of(pattern() * 0.1, kEyes, p), Contains("too dark"));
  EXPECT_THAT(problems_of(pattern() * 0.1 + 225, kEyes, p), Contains("too bright"));
  EXPECT_THAT(problems_of(pattern() * 0.05 + 120, kEyes, p), Contains("too little contrast"));
  EXPECT_THAT(problems_of(pattern() * 3, kEyes, p), Contains("overexposed"));
  cv::Mat shaded = pattern();
  shaded.colRange(0, 64) *= 0.1;
  EXPECT_THAT(problems_of(shaded, kEyes, p), Contains("lit from one side"));
}

TEST(QualityTest, AsymmetryGivesTheTurnWithoutLandmarks) {
  EXPECT_LT(measure_quality(pattern(), kEyes, {}).turn, 0.1);
  cv::Mat other;
  cv::Mat moved = (cv::Mat_<double>(2, 3) << 1, 0, 20, 0, 1, 0);
  cv::warpAffine(pattern(), other, moved, {128, 160}, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  EXPECT_GT(measure_quality(other, kEyes, {}).turn, 0.35);
}

}  // namespace
}  // namespace tarsier::face::people
