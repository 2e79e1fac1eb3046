// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/calibration.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"
#include "tarsier/linalg/model_fields.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>
#include <numbers>
#include <stdexcept>

namespace tarsier::face::recognition {
namespace {

double normal_below(double z) { return std::erfc(-z / std::numbers::sqrt2) / 2; }
double normal_above(double z) { return std::erfc(z / std::numbers::sqrt2) / 2; }

// Mean and variance of the maximum of n standard normal numbers, n >= 1 (not only integers):
// integrals of the tails of its distribution function Phi^n.
struct Greatest {
  double mean = 0;
  double variance = 0;
};
Greatest greatest_of(double n) {
  constexpr double kStep = 0.01;
  double mean = 0;
  double square = 0;
  for (double z = kStep / 2; z < 12; z += kStep) {
    const double above = -std::expm1(n * std::log1p(-normal_above(z)));  // P(greatest > z)
    const double below = std::exp(n * std::log(normal_below(-z)));       // P(greatest < -z)
    mean += (above - below) * kStep;
    square += 2 * z * (above + below) * kStep;
  }
  return {mean, square - mean * mean};
}

// z with P(standard normal > z) = p, by bisection.
double normal_quantile_above(double p) {
  double low = -40;
  double high = 40;
  for (int i = 0; i < 200; ++i) {
    const double middle = (low + high) / 2;
    (normal_above(middle) > p ? low : high) = middle;
  }
  return (low + high) / 2;
}

struct Moments {
  double mean = 0;
  double variance = 0;
  double people = 0;
};

// Moments with equal weight for every person.
Moments moments_of(const std::vector<double>& scores, const std::vector<int>& people) {
  std::map<int, double> count;
  for (const int person : people) count[person] += 1;
  Moments moments;
  moments.people = static_cast<double>(count.size());
  if (scores.empty()) return moments;
  for (std::size_t i = 0; i < scores.size(); ++i)
    moments.mean += scores[i] / (count[people[i]] * moments.people);
  for (std::size_t i = 0; i < scores.size(); ++i)
    moments.variance += (scores[i] - moments.mean) * (scores[i] - moments.mean) /
                        (count[people[i]] * moments.people);
  if (moments.people > 1) moments.variance *= moments.people / (moments.people - 1);
  return moments;
}

double mean_of(const std::vector<double>& values) {
  double sum = 0;
  for (const double value : values) sum += value;
  return values.empty() ? 0 : sum / static_cast<double>(values.size());
}

// Logistic regression by Newton's method on t = (score - centre) / unit. Both classes have the same
// weight; targets are smoothed (Platt, "Probabilistic outputs for support vector machines", 1999).
void fit_logistic(Calibration& calibration, const std::vector<double>& genuine,
                  const std::vector<double>& stranger, double centre, double unit) {
  double a = 1;
  double b = 0;
  const auto np = static_cast<double>(genuine.size());
  const auto nn = static_cast<double>(stranger.size());
  const double high = (np + 1) / (np + 2);
  const double low = 1 / (nn + 2);
  for (int iteration = 0; iteration < 100; ++iteration) {
    double ga = 1e-6 * a;
    double gb = 0;
    double haa = 1e-6;
    double hab = 0;
    double hbb = 1e-9;
    const auto add = [&](double score, double target, double weight) {
      const double t = (score - centre) / unit;
      const double p = logistic(a * t + b);
      const double w = std::max(p * (1 - p), 1e-9) * weight;
      ga += weight * (p - target) * t;
      gb += weight * (p - target);
      haa += w * t * t;
      hab += w * t;
      hbb += w;
    };
    for (const double score : genuine) add(score, high, 1 / np);
    for (const double score : stranger) add(score, low, 1 / nn);
    const double determinant = haa * hbb - hab * hab;
    if (!(determinant > 0)) break;
    const double da = (hbb * ga - hab * gb) / determinant;
    const double db = (haa * gb - hab * ga) / determinant;
    const double step = std::min(1.0, 2 / std::max(std::abs(da), std::abs(db)));
    a = std::clamp(a - step * da, 0.0, 1e3);
    b -= step * db;
    if (std::abs(da) + std::abs(db) < 1e-10) break;
  }
  calibration.slope = a / unit;
  calibration.offset = b - a * centre / unit;
}

}  // namespace

void Calibration::check() const {
  TARSIER_REQUIRE(std::isfinite(location) && std::isfinite(scale) && scale > 0,
                  "location {}, scale {}", location, scale);
  TARSIER_REQUIRE(std::isfinite(gallery) && gallery >= 1, "gallery {}", gallery);
  TARSIER_REQUIRE(std::isfinite(slope) && slope >= 0 && std::isfinite(offset),
                  "slope {}, offset {}", slope, offset);
  TARSIER_REQUIRE(genuine_scores >= 0 && stranger_scores >= 0 && stranger_people >= 0 &&
                      std::isfinite(genuine_mean),
                  "{} genuine, {} strangers' scores of {}", genuine_scores, stranger_scores,
                  stranger_people);
}

double Calibration::false_accept_rate(double score, int people) const {
  TARSIER_REQUIRE(people >= 1, "{} people", people);
  return -std::expm1(people * std::log1p(-normal_above((score - location) / scale)));
}

double Calibration::threshold(double rate, int people) const {
  TARSIER_REQUIRE(rate > 0 && rate < 1, "rate {}", rate);
  TARSIER_REQUIRE(people >= 1, "{} people", people);
  // 1 - (1 - rate)^(1 / people): the rate for a single comparison.
  return location + scale * normal_quantile_above(-std::expm1(std::log1p(-rate) / people));
}

double Calibration::probability(double score) const { return logistic(slope * score + offset); }

Calibration fit_calibration(const ScoreSample& sample, const CalibrationPrior& prior) {
  TARSIER_REQUIRE(sample.stranger.size() == sample.stranger_person.size(),
                  "{} scores of strangers, {} people", sample.stranger.size(),
                  sample.stranger_person.size());
  for (const auto* list : {&sample.genuine, &sample.stranger})
    for (const double score : *list) TARSIER_REQUIRE(std::isfinite(score), "a score is not finite");
  TARSIER_REQUIRE(sample.gallery >= 1 && prior.weight >= 0 && prior.scale > 0, "gallery {}",
                  sample.gallery);
  TARSIER_REQUIRE(!sample.stranger.empty() || prior.weight > 0, "no scores of strangers");
  Calibration out;
  out.gallery = sample.stranger.empty() ? 1 : sample.gallery;
  out.genuine_scores = static_cast<int>(sample.genuine.size());
  out.stranger_scores = static_cast<int>(sample.stranger.size());
  const Moments seen = moments_of(sample.stranger, sample.stranger_person);
  out.stranger_people = static_cast<int>(seen.people);
  const Greatest greatest = greatest_of(out.gallery);
  const double total = seen.people + prior.weight;
  const double believed_mean = prior.location + prior.scale * greatest.mean;
  const double believed_variance = prior.scale * prior.scale * greatest.variance;
  const double mean = (seen.people * seen.mean + prior.weight * believed_mean) / total;
  const double variance = (seen.people * seen.variance + prior.weight * believed_variance) / total;
  // The mean is estimated from few strangers; this adds its uncertainty to the variance.
  const double unsure = seen.people > 0 ? 1 + 1 / total : 1;
  out.scale = std::max(std::sqrt(unsure * variance / greatest.variance), 1e-9);
  out.location = mean - greatest.mean * out.scale;

  // Without scores, use the prior's mean and standard deviation.
  const double spread = std::max(std::sqrt(variance), 1e-9);
  std::vector<double> genuine = sample.genuine;
  std::vector<double> stranger = sample.stranger;
  if (genuine.empty()) {
    const double middle =
        std::max(prior.weight > 0 ? prior.genuine : mean + 4 * spread, mean + 2 * spread);
    genuine = {middle - spread, middle, middle + spread};
  }
  if (stranger.empty()) stranger = {mean - spread, mean, mean + spread};
  out.genuine_mean = mean_of(genuine);
  const double centre = (out.genuine_mean + mean_of(stranger)) / 2;
  fit_logistic(out, genuine, stranger, centre, spread);
  return out;
}

namespace {

void list_calibration(linalg::ModelFields& file, Calibration& calibration) {
  constexpr double kMost = 1e12;
  constexpr std::int64_t kCount = 1'000'000'000;
  file.number("location", calibration.location, -kMost, kMost);
  file.number("scale", calibration.scale, 1e-12, kMost);
  file.number("gallery", calibration.gallery, 1, kMost);
  file.number("slope", calibration.slope, 0, kMost);
  file.number("offset", calibration.offset, -1e15, 1e15);
  file.whole("genuine_scores", calibration.genuine_scores, 0, kCount);
  file.whole("stranger_scores", calibration.stranger_scores, 0, kCount);
  file.whole("stranger_people", calibration.stranger_people, 0, kCount);
  file.number("genuine_mean", calibration.genuine_mean, -kMost, kMost);
}

}  // namespace

nlohmann::json to_json(const Calibration& calibration) {
  calibration.check();
  return linalg::written(calibration, list_calibration);
}

Calibration calibration_from_json(const nlohmann::json& value, const std::string& path) {
  return linalg::read_fields<Calibration>(value, path, list_calibration);
}

}  // namespace tarsier::face::recognition
