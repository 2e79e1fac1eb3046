// SPDX-License-Identifier: MIT
#include "tarsier/core/statistics.h"

#include "tarsier/core/boxes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <type_traits>
#include <vector>

namespace tarsier {
namespace {

TEST(LogOdds, AreZeroAtOneHalfAndBounded) {
  EXPECT_EQ(log_odds(0.5), 0);
  EXPECT_NEAR(log_odds(0.9), std::log(9), 1e-12);
  EXPECT_NEAR(log_odds(0.2), -log_odds(0.8), 1e-12);
  EXPECT_NEAR(log_odds(1), std::log(9999), 1e-9);
  EXPECT_NEAR(log_odds(0, 0.01), -std::log(99), 1e-9);
}

TEST(WilsonInterval, MatchesValuesComputedByHand) {
  // z = 1.959964, z^2 = 3.841459.
  const Interval all = wilson_interval(10, 10);
  EXPECT_NEAR(all.low, 1 / (1 + 0.3841459), 1e-6);
  EXPECT_EQ(all.high, 1);
  const Interval none = wilson_interval(0, 100);
  EXPECT_EQ(none.low, 0);
  EXPECT_NEAR(none.high, 0.0384146 / 1.0384146, 1e-6);
  const Interval half = wilson_interval(50, 100);
  EXPECT_NEAR(half.low, 0.403832, 1e-5);
  EXPECT_NEAR(half.high, 0.596168, 1e-5);
  const Interval plates = wilson_interval(34, 37);
  EXPECT_NEAR(plates.low, 0.787, 1e-3);
  EXPECT_NEAR(plates.high, 0.972, 1e-3);
}

TEST(WilsonInterval, IsSymmetricAndShrinksWithTheTrials) {
  const Interval few = wilson_interval(3, 20);
  const Interval mirrored = wilson_interval(17, 20);
  EXPECT_NEAR(few.low, 1 - mirrored.high, 1e-12);
  EXPECT_NEAR(few.high, 1 - mirrored.low, 1e-12);
  const Interval many = wilson_interval(300, 2000);
  EXPECT_GT(many.low, few.low);
  EXPECT_LT(many.high, few.high);
  const Interval wider = wilson_interval(3, 20, 0.99);
  EXPECT_LT(wider.low, few.low);
  EXPECT_GT(wider.high, few.high);
}

TEST(WilsonInterval, OfARateIsThatOfTheCount) {
  const Interval counted = wilson_interval(7, 40);
  const Interval rated = wilson_interval_of_rate(7.0 / 40, 40);
  EXPECT_DOUBLE_EQ(counted.low, rated.low);
  EXPECT_DOUBLE_EQ(counted.high, rated.high);
}

TEST(WilsonInterval, IsZeroToOneWithoutTrialsAndRefusesInvalidCounts) {
  EXPECT_EQ(wilson_interval(0, 0).low, 0);
  EXPECT_EQ(wilson_interval(0, 0).high, 1);
  EXPECT_THROW((void)wilson_interval(-1, 5), std::invalid_argument);
  EXPECT_THROW((void)wilson_interval(6, 5), std::invalid_argument);
  EXPECT_THROW((void)wilson_interval(1, 5, 1), std::invalid_argument);
  EXPECT_THROW((void)wilson_interval_of_rate(1.1, 5), std::invalid_argument);
}

TEST(Quantiles, InterpolateBetweenNeighbours) {
  const std::vector<double> sorted = {1, 2, 4, 8, 16};
  EXPECT_EQ(quantile(sorted, 0), 1);
  EXPECT_EQ(quantile(sorted, 0.5), 4);
  EXPECT_DOUBLE_EQ(quantile(sorted, 0.9), 12.8);
  EXPECT_EQ(quantile(sorted, 1), 16);
  EXPECT_EQ(quantile({}, 0.5), 0);
  EXPECT_THROW((void)quantile(sorted, 1.01), std::invalid_argument);
  EXPECT_EQ(upper_median({9, 1, 5}), 5);
  EXPECT_EQ(upper_median({9, 1, 5, 2}), 5);
  EXPECT_EQ(upper_median({}), 0);
}

TEST(Quantiles, NearestRankReturnsOneOfTheValues) {
  const std::vector<double> even = {16, 4, 2, 8};
  const auto of = [&even](double (*rule)(std::vector<double>&, double), double share) {
    std::vector<double> values = even;
    return rule(values, share);
  };
  EXPECT_EQ(of(upper_quantile<double>, 0.5), 8);
  EXPECT_EQ(of(lower_quantile<double>, 0.5), 4);
  EXPECT_EQ(of(nearest_quantile<double>, 0.5), 8);
  EXPECT_EQ(of(upper_quantile<double>, 0.3), 4);    // 1.2 of 4
  EXPECT_EQ(of(lower_quantile<double>, 0.3), 2);    // 0.9 of 3
  EXPECT_EQ(of(nearest_quantile<double>, 0.3), 4);  // 0.9 of 3
  for (const auto rule :
       {upper_quantile<double>, lower_quantile<double>, nearest_quantile<double>}) {
    EXPECT_EQ(of(rule, 0), 2);
    EXPECT_EQ(of(rule, 1), 16);
    EXPECT_THROW((void)of(rule, -0.01), std::invalid_argument);
    EXPECT_THROW((void)of(rule, 1.01), std::invalid_argument);
    std::vector<double> none;
    EXPECT_EQ(rule(none, 0.5), 0);
  }
}

TEST(Quantiles, AcceptFloatsAndIntegers) {
  const std::vector<float> values = {9, 1, 5, 2};
  EXPECT_EQ(upper_median(values), 5.0F);
  EXPECT_EQ(values, (std::vector<float>{9, 1, 5, 2}));  // a copy was sorted
  EXPECT_EQ(upper_median(std::vector<std::uint8_t>{200, 7, 9}), 9);
  EXPECT_EQ(upper_median(std::vector<int>{}), 0);
}

TEST(Logistic, IsTheInverseOfTheLogOdds) {
  for (const double p : {0.001, 0.2, 0.5, 0.75, 0.999})
    EXPECT_NEAR(logistic(log_odds(p)), p, 1e-15);
  EXPECT_EQ(logistic(0.0), 0.5);
  EXPECT_NEAR(logistic(-30.0) * (1 + std::exp(30)), 1, 1e-15);  // no digits are lost
  EXPECT_EQ(logistic(1e4), 1);
  EXPECT_EQ(logistic(-1e4), 0);
  EXPECT_TRUE(std::isnan(logistic(std::nan(""))));
}

// Scores of networks are floats, so the result must equal float arithmetic.
TEST(Logistic, OfFloatIsComputedInFloat) {
  const float x = 0.3F;
  EXPECT_EQ(logistic(x), 1.0F / (1.0F + std::exp(-x)));
  EXPECT_NE(static_cast<double>(logistic(x)), logistic(static_cast<double>(x)));
  EXPECT_EQ(logistic(-200.0F), 0.0F);
}

TEST(Boxes, IouAndOverlapOfSmallerDiffer) {
  const cv::Rect2d outer(0, 0, 10, 10);
  const cv::Rect2d inside(2, 2, 5, 5);
  EXPECT_DOUBLE_EQ(iou(outer, inside), 0.25);
  EXPECT_DOUBLE_EQ(overlap_of_smaller(outer, inside), 1);
  EXPECT_DOUBLE_EQ(iou(outer, {5, 0, 10, 10}), 1.0 / 3);
  EXPECT_DOUBLE_EQ(overlap_of_smaller(outer, {5, 0, 10, 10}), 0.5);
  EXPECT_EQ(iou(outer, {10, 0, 5, 5}), 0);                // they touch
  EXPECT_EQ(overlap_of_smaller(outer, {2, 2, 0, 5}), 0);  // empty
  EXPECT_DOUBLE_EQ(iou(cv::Rect(0, 0, 10, 10), cv::Rect(5, 0, 10, 10)), 1.0 / 3);
}

TEST(Boxes, OverlapOfEmptyBoxesIsZero) {
  const cv::Rect2d empty(3, 3, 0, 0);
  EXPECT_EQ(iou(empty, empty), 0);
  EXPECT_EQ(overlap_of_smaller(empty, empty), 0);
  const double inf = std::numeric_limits<double>::infinity();
  const cv::Rect2d endless(0, 0, inf, inf);
  EXPECT_EQ(iou(endless, endless), 0);
  EXPECT_EQ(overlap_of_smaller(endless, endless), 0);
  EXPECT_EQ(overlap_of_smaller(cv::Rect2d(0, 0, 10, 10), endless), 1);
}

TEST(Boxes, FloatBoxesAreComparedInFloat) {
  const cv::Rect2f a(0, 0, 10, 10);
  const cv::Rect2f b(5, 0, 10, 10);
  static_assert(std::is_same_v<decltype(iou(a, b)), float>);
  EXPECT_EQ(iou(a, b), 50.0F / 150.0F);
  EXPECT_EQ(overlap_of_smaller(a, b), 0.5F);
}

}  // namespace
}  // namespace tarsier
