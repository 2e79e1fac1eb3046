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

double normal_cdf(double z) { return std::erfc(-z / std::numbers::sqrt2) / 2; }
double normal_upper_tail(double z) { return std::erfc(z / std::numbers::sqrt2) / 2; }

// Mean and variance of the maximum of n standard normal numbers, n >= 1 (not only integers):
// integrals of the tails of its distribution function Phi^n.
struct MaximumMoments {
  double mean = 0;
  double variance = 0;
};
MaximumMoments moments_of_maximum(double n) {
  constexpr double kStep = 0.01;
  double mean = 0;
  double square = 0;
  for (double z = kStep / 2; z < 12; z += kStep) {
    const double above = -std::expm1(n * std::log1p(-normal_upper_tail(z)));  // P(maximum > z)
    const double below = std::exp(n * std::log(normal_cdf(-z)));              // P(maximum < -z)
    mean += (above - below) * kStep;
    square += 2 * z * (above + below) * kStep;
  }
  return {mean, square - mean * mean};
}

// z with P(standard normal > z) = p, by bisection.
double normal_upper_quantile(double p) {
  double low = -40;
  double high = 40;
  for (int i = 0; i < 200; ++i) {
    const double middle = (low + high) / 2;
    (normal_upper_tail(middle) > p ? low : high) = middle;
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
                  const std::vector<double>& impostor, double centre, double unit) {
  double a = 1;
  double b = 0;
  const auto np = static_cast<double>(genuine.size());
  const auto nn = static_cast<double>(impostor.size());
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
    for (const double score : impostor) add(score, low, 1 / nn);
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
  TARSIER_REQUIRE(genuine_scores >= 0 && impostor_scores >= 0 && impostor_people >= 0 &&
                      std::isfinite(genuine_mean),
                  "{} genuine, {} strangers' scores of {}", genuine_scores, impostor_scores,
                  impostor_people);
}

double Calibration::false_accept_rate(double score, int people) const {
  TARSIER_REQUIRE(people >= 1, "{} people", people);
  return -std::expm1(people * std::log1p(-normal_upper_tail((score - location) / scale)));
}

double Calibration::threshold(double rate, int people) const {
  TARSIER_REQUIRE(rate > 0 && rate < 1, "rate {}", rate);
  TARSIER_REQUIRE(people >= 1, "{} people", people);
  // 1 - (1 - rate)^(1 / people): the rate for a single comparison.
  return location + scale * normal_upper_quantile(-std::expm1(std::log1p(-rate) / people));
}

double Calibration::probability(double score) const { return logistic(slope * score + offset); }

Calibration fit_calibration(const ScoreSample& sample, const CalibrationPrior& prior) {
  TARSIER_REQUIRE(sample.impostor.size() == sample.impostor_person.size(),
                  "{} scores of strangers, {} people", sample.impostor.size(),
                  sample.impostor_person.size());
  for (const auto* list : {&sample.genuine, &sample.impostor})
    for (const double score : *list) TARSIER_REQUIRE(std::isfinite(score), "a score is not finite");
  TARSIER_REQUIRE(sample.gallery >= 1 && prior.weight >= 0 && prior.scale > 0, "gallery {}",
                  sample.gallery);
  TARSIER_REQUIRE(!sample.impostor.empty() || prior.weight > 0, "no scores of strangers");
  Calibration out;
  out.gallery = sample.impostor.empty() ? 1 : sample.gallery;
  out.genuine_scores = static_cast<int>(sample.genuine.size());
  out.impostor_scores = static_cast<int>(sample.impostor.size());
  const Moments observed = moments_of(sample.impostor, sample.impostor_person);
  out.impostor_people = static_cast<int>(observed.people);
  const MaximumMoments maximum = moments_of_maximum(out.gallery);
  const double total = observed.people + prior.weight;
  const double prior_mean = prior.location + prior.scale * maximum.mean;
  const double prior_variance = prior.scale * prior.scale * maximum.variance;
  const double mean = (observed.people * observed.mean + prior.weight * prior_mean) / total;
  const double variance =
      (observed.people * observed.variance + prior.weight * prior_variance) / total;
  // The mean is estimated from few strangers; this adds its uncertainty to the variance.
  const double variance_inflation = observed.people > 0 ? 1 + 1 / total : 1;
  out.scale = std::max(std::sqrt(variance_inflation * variance / maximum.variance), 1e-9);
  out.location = mean - maximum.mean * out.scale;

  // Without scores, use the prior's mean and standard deviation.
  const double spread = std::max(std::sqrt(variance), 1e-9);
  std::vector<double> genuine = sample.genuine;
  std::vector<double> impostor = sample.impostor;
  if (genuine.empty()) {
    const double middle =
        std::max(prior.weight > 0 ? prior.genuine : mean + 4 * spread, mean + 2 * spread);
    genuine = {middle - spread, middle, middle + spread};
  }
  if (impostor.empty()) impostor = {mean - spread, mean, mean + spread};
  out.genuine_mean = mean_of(genuine);
  const double centre = (out.genuine_mean + mean_of(impostor)) / 2;
  fit_logistic(out, genuine, impostor, centre, spread);
  return out;
}

namespace {

void list_calibration(linalg::ModelFields& file, Calibration& calibration) {
  constexpr double kMaxNumber = 1e12;
  constexpr std::int64_t kMaxCount = 1'000'000'000;
  file.number("location", calibration.location, -kMaxNumber, kMaxNumber);
  file.number("scale", calibration.scale, 1e-12, kMaxNumber);
  file.number("gallery", calibration.gallery, 1, kMaxNumber);
  file.number("slope", calibration.slope, 0, kMaxNumber);
  file.number("offset", calibration.offset, -1e15, 1e15);
  file.whole("genuine_scores", calibration.genuine_scores, 0, kMaxCount);
  file.whole("stranger_scores", calibration.impostor_scores, 0, kMaxCount);
  file.whole("stranger_people", calibration.impostor_people, 0, kMaxCount);
  file.number("genuine_mean", calibration.genuine_mean, -kMaxNumber, kMaxNumber);
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
