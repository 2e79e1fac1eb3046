// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/calibration.h"

#include "tarsier/core/rng.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace tarsier::face::recognition {
namespace {

// The max of `people` normal scores.
double best_of(Rng& rng, int people) {
  double best = -1e9;
  for (int i = 0; i < people; ++i) best = std::max(best, rng.normal(0.1, 0.1));
  return best;
}

ScoreSample sample_of(int people, int impostors, int each, std::uint64_t seed = 5) {
  Rng rng(seed);
  ScoreSample sample;
  sample.gallery = people;
  for (int s = 0; s < impostors; ++s) {
    for (int k = 0; k < each; ++k) {
      sample.impostor.push_back(best_of(rng, people));
      sample.impostor_person.push_back(s);
    }
  }
  for (int i = 0; i < impostors * each; ++i) sample.genuine.push_back(rng.normal(0.7, 0.1));
  return sample;
}

// How often new impostors reach the thresholds of models that were each calibrated with few others.
double observed_rate(double rate, int fitted_people, int people) {
  double sum = 0;
  constexpr int kModels = 100;
  for (int i = 0; i < kModels; ++i) {
    const auto calibration = fit_calibration(
        sample_of(fitted_people, 20, 1, 100U + static_cast<unsigned>(i)), {0, 1, 0, 0});
    const double threshold = calibration.threshold(rate, people);
    Rng rng(6 + static_cast<std::uint64_t>(i));
    int accepted = 0;
    for (int k = 0; k < 2000; ++k)
      if (best_of(rng, people) >= threshold) ++accepted;
    sum += accepted / 2000.0 / kModels;
  }
  return sum;
}

TEST(Calibration, FalseAcceptRateHoldsForNewImpostors) {
  for (const double rate : {0.1, 0.01}) {
    EXPECT_GT(observed_rate(rate, 20, 20), rate / 2);
    EXPECT_LT(observed_rate(rate, 20, 20), rate * 2);
  }
}

TEST(Calibration, FalseAcceptRateHoldsForOtherGallerySizes) {
  EXPECT_GT(observed_rate(0.05, 20, 80), 0.05 / 2);
  EXPECT_LT(observed_rate(0.05, 20, 80), 0.05 * 2);
  const auto calibration = fit_calibration(sample_of(20, 20, 5), {0, 1, 0, 0});
  EXPECT_GT(calibration.threshold(0.01, 200), calibration.threshold(0.01, 20));
  EXPECT_LT(calibration.threshold(0.01, 5), calibration.threshold(0.01, 20));
}

TEST(Calibration, ThresholdAndRateAreInverse) {
  const auto calibration = fit_calibration(sample_of(10, 10, 3), {0, 1, 0, 0});
  for (const double rate : {0.5, 0.1, 0.01, 1e-4})
    EXPECT_NEAR(calibration.false_accept_rate(calibration.threshold(rate, 7), 7), rate,
                1e-9 + 1e-6 * rate);
}

TEST(Calibration, ProbabilityRisesWithTheScore) {
  const auto calibration = fit_calibration(sample_of(10, 10, 3), {0, 1, 0, 0});
  EXPECT_LT(calibration.probability(0.2), 0.1);
  EXPECT_GT(calibration.probability(0.7), 0.9);
  double last = 0;
  for (double score = -1; score <= 1; score += 0.05) {
    EXPECT_GE(calibration.probability(score), last);
    last = calibration.probability(score);
  }
}

TEST(Calibration, IsFiniteForSeparableScores) {
  ScoreSample sample;
  sample.genuine = {0.9, 0.9, 0.9};
  sample.impostor = {0.1, 0.1, 0.1};
  sample.impostor_person = {0, 1, 2};
  const auto calibration = fit_calibration(sample, {0, 1, 0, 0});
  EXPECT_NO_THROW(calibration.check());
  EXPECT_TRUE(std::isfinite(calibration.probability(0.5)));
}

TEST(Calibration, UsesThePriorWithoutImpostorScores) {
  const CalibrationPrior prior{0.2, 0.05, 0.6, 2};
  const auto calibration = fit_calibration({}, prior);
  EXPECT_EQ(calibration.impostor_people, 0);
  EXPECT_NEAR(calibration.location, 0.2, 1e-9);
  EXPECT_NEAR(calibration.scale, 0.05, 1e-9);
  EXPECT_GT(calibration.probability(0.6), calibration.probability(0.3));
  EXPECT_THROW((void)fit_calibration({}, {0, 1, 0, 0}), std::invalid_argument);
}

TEST(Calibration, RejectsInvalidInput) {
  ScoreSample sample = sample_of(3, 3, 2);
  sample.impostor[2] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW((void)fit_calibration(sample, {}), std::invalid_argument);
  sample = sample_of(3, 3, 2);
  sample.impostor_person.pop_back();
  EXPECT_THROW((void)fit_calibration(sample, {}), std::invalid_argument);
  const auto calibration = fit_calibration(sample_of(3, 3, 2), {});
  EXPECT_THROW((void)calibration.threshold(0, 3), std::invalid_argument);
  EXPECT_THROW((void)calibration.threshold(0.1, 0), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::recognition
