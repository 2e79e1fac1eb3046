// SPDX-License-Identifier: MIT
#include "tarsier/face/appearance/fit.h"

#include "tarsier/core/progress.h"
#include "tarsier/face/appearance/testing_portraits.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

namespace tarsier::face::appearance {
namespace {

const AppearanceModel& colour_model() {
  static const AppearanceModel result = [] {
    NoProgress silent;
    return train_appearance_model(test_support::portraits(40, 1), {}, {}, silent, {});
  }();
  return result;
}

double mean_error(const Eigen::Matrix2Xd& points, const TrainingImage& truth) {
  return (points - truth.points).colwise().norm().mean();
}

// The mean shape at the object, displaced by a tenth of its size.
Eigen::Matrix2Xd disturbed_start(const TrainingImage& image, Rng& rng) {
  shape::Similarity2d similarity = shape::fit_similarity(colour_model().shape.mean, image.points);
  similarity.tx += rng.uniform(-4, 4);
  similarity.ty += rng.uniform(-4, 4);
  return similarity(colour_model().shape.mean);
}

class FitMethodTest : public ::testing::TestWithParam<Method> {};

TEST_P(FitMethodTest, FitsUnseenImages) {
  FitOptions options;
  options.method = GetParam();
  const Fitter fitter(colour_model(), options);
  FitWorkspace workspace;
  Rng rng(5);
  int right = 0;
  for (const TrainingImage& unseen : test_support::portraits(12, 77)) {
    const Eigen::Matrix2Xd start = disturbed_start(unseen, rng);
    const FitResult fit = fitter.fit(unseen.image, start, workspace);
    if (mean_error(fit.points, unseen) < 1.0 && !fit.lost) ++right;
  }
  EXPECT_GE(right, 11);
}

INSTANTIATE_TEST_SUITE_P(Both, FitMethodTest,
                         ::testing::Values(Method::kProjectOut, Method::kAlternating));

TEST(Fit, DoesNotDependOnEarlierFits) {
  const Fitter fitter(colour_model(), {});
  FitWorkspace first;
  FitWorkspace second;
  Rng rng(5);
  const TrainingImage unseen = test_support::portraits(1, 78)[0];
  const Eigen::Matrix2Xd start = disturbed_start(unseen, rng);
  const FitResult a = fitter.fit(unseen.image, start, first);
  (void)fitter.fit(test_support::portraits(1, 3)[0].image, start, second);
  const FitResult b = fitter.fit(unseen.image, start, second);
  EXPECT_EQ(a.points, b.points);
  EXPECT_EQ(a.error, b.error);
}

TEST(Fit, ReportsNoiseImageAsLost) {
  const Fitter fitter(colour_model(), {});
  FitWorkspace workspace;
  Rng rng(5);
  const TrainingImage unseen = test_support::portraits(1, 78)[0];
  cv::Mat noise(unseen.image.size(), CV_8UC3);
  for (int y = 0; y < noise.rows; ++y) {
    for (int x = 0; x < noise.cols; ++x) {
      const auto value = static_cast<std::uint8_t>(rng.integer(0, 255));
      noise.at<cv::Vec3b>(y, x) = {value, value, value};
    }
  }
  const FitResult fit = fitter.fit(noise, disturbed_start(unseen, rng), workspace);
  EXPECT_TRUE(fit.lost || fit.error > 0.5) << fit.error;
}

TEST(Fit, StaysFinitePartlyOutsideTheImage) {
  const Fitter fitter(colour_model(), {});
  FitWorkspace workspace;
  Rng rng(5);
  const TrainingImage unseen = test_support::portraits(1, 78)[0];
  const Eigen::Matrix2Xd start = disturbed_start(unseen, rng).colwise() + Eigen::Vector2d(-70, 60);
  EXPECT_TRUE(fitter.fit(unseen.image, start, workspace).points.allFinite());
}

TEST(Fit, RejectsInvalidStarts) {
  const Fitter fitter(colour_model(), {});
  FitWorkspace workspace;
  const TrainingImage unseen = test_support::portraits(1, 78)[0];
  Eigen::Matrix2Xd start = unseen.points;
  start(0, 3) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW((void)fitter.fit(unseen.image, start, workspace), std::invalid_argument);
  EXPECT_THROW((void)fitter.fit(unseen.image, unseen.points.leftCols(5), workspace),
               std::invalid_argument);
  start.colwise() = Eigen::Vector2d(50, 50);
  EXPECT_THROW((void)fitter.fit(unseen.image, start, workspace), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::appearance
