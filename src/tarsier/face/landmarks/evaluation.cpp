// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/evaluation.h"

#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tarsier::face::landmarks {

namespace {

constexpr double kFailureNme = 8;  // %

double error_of(const FitOutcome& outcome) {
  return outcome.missed || outcome.wrong ? std::numeric_limits<double>::infinity() : outcome.nme;
}

}  // namespace

bool has_eye_distance(const Eigen::Matrix2Xd& truth, const std::array<int, 2>& eyes) {
  for (const int eye : eyes) {
    TARSIER_REQUIRE(eye >= 0 && eye < truth.cols(), "eye {} of {} points", eye, truth.cols());
  }
  return (truth.col(eyes[0]) - truth.col(eyes[1])).norm() > 0;
}

FitOutcome evaluate_fit(const std::optional<Eigen::Matrix2Xd>& fitted,
                        const Eigen::Matrix2Xd& truth, const std::array<int, 2>& eyes) {
  TARSIER_REQUIRE(has_eye_distance(truth, eyes), "the eyes lie in one place");
  const double unit = (truth.col(eyes[0]) - truth.col(eyes[1])).norm();
  FitOutcome outcome;
  if (!fitted) {
    outcome.missed = true;
    return outcome;
  }
  TARSIER_REQUIRE(fitted->cols() == truth.cols(), "{} points, the truth has {}", fitted->cols(),
                  truth.cols());
  const Eigen::Vector2d displacement = fitted->rowwise().mean() - truth.rowwise().mean();
  if (displacement.norm() > unit) {
    outcome.wrong = true;
    return outcome;
  }
  outcome.nme = (*fitted - truth).colwise().norm().mean() / unit * 100;
  outcome.dx = displacement.x() / unit * 100;
  outcome.dy = displacement.y() / unit * 100;
  return outcome;
}

LandmarkScore score_of(const std::vector<FitOutcome>& outcomes) {
  LandmarkScore score;
  score.faces = static_cast<int>(outcomes.size());
  std::vector<double> errors;
  double failed = 0;
  for (const FitOutcome& outcome : outcomes) {
    score.missed += outcome.missed ? 1 : 0;
    score.wrong += outcome.wrong ? 1 : 0;
    if (error_of(outcome) >= kFailureNme) ++failed;
    if (outcome.missed || outcome.wrong) continue;
    errors.push_back(outcome.nme);
    score.dx += outcome.dx;
    score.dy += outcome.dy;
  }
  if (outcomes.empty()) return score;
  score.failures = failed / score.faces;
  if (!errors.empty()) {
    const auto found = static_cast<double>(errors.size());
    for (const double error : errors) score.mean += error / found;
    score.dx /= found;
    score.dy /= found;
    std::sort(errors.begin(), errors.end());
    score.median = quantile(errors, 0.5);
    score.p90 = quantile(errors, 0.9);
  }
  // Trapezoidal rule over 0, 0.008 .. 8 %.
  std::vector<double> at(1001);
  for (std::size_t i = 0; i < at.size(); ++i) at[i] = kFailureNme * static_cast<double>(i) / 1000;
  const std::vector<double> curve = cumulative(outcomes, at);
  for (std::size_t i = 1; i < curve.size(); ++i) score.auc += (curve[i] + curve[i - 1]) / 2000;
  return score;
}

std::vector<double> cumulative(const std::vector<FitOutcome>& outcomes,
                               const std::vector<double>& errors) {
  std::vector<double> sorted;
  sorted.reserve(outcomes.size());
  for (const FitOutcome& outcome : outcomes) sorted.push_back(error_of(outcome));
  std::sort(sorted.begin(), sorted.end());
  std::vector<double> shares;
  for (const double error : errors) {
    const auto within = std::upper_bound(sorted.begin(), sorted.end(), error) - sorted.begin();
    shares.push_back(
        sorted.empty() ? 0.0 : static_cast<double>(within) / static_cast<double>(sorted.size()));
  }
  return shares;
}

}  // namespace tarsier::face::landmarks
