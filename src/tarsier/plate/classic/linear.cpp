// SPDX-License-Identifier: MIT
#include "tarsier/plate/classic/linear.h"

#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tarsier::plate {

double LinearModel::margin(const float* x) const {
  auto sum = static_cast<double>(bias);
  for (std::size_t i = 0; i < weights.size(); ++i)
    sum += static_cast<double>(weights[i]) * static_cast<double>(x[i]);
  return sum;
}

LinearModel train_linear_svm(const cv::Mat& rows, const std::vector<int>& labels, double cost,
                             int iterations, Rng rng) {
  TARSIER_REQUIRE(rows.type() == CV_32F && rows.rows == static_cast<int>(labels.size()),
                  "{} rows, {} labels", rows.rows, labels.size());
  TARSIER_REQUIRE(cost > 0 && iterations > 0, "cost {}, {} iterations", cost, iterations);
  const auto count = labels.size();
  const auto width = static_cast<std::size_t>(rows.cols);
  LinearModel model;
  model.weights.assign(width, 0);
  std::vector<double> alpha(count, 0);
  std::vector<double> diagonal(count);
  for (std::size_t i = 0; i < count; ++i) {
    const auto* x = rows.ptr<float>(static_cast<int>(i));
    double sum = 1;  // the bias
    for (std::size_t k = 0; k < width; ++k)
      sum += static_cast<double>(x[k]) * static_cast<double>(x[k]);
    diagonal[i] = sum;
  }
  std::vector<std::size_t> order(count);
  std::iota(order.begin(), order.end(), std::size_t{0});
  for (int round = 0; round < iterations; ++round) {
    for (std::size_t i = count; i > 1; --i)
      std::swap(order[i - 1],
                order[static_cast<std::size_t>(rng.integer(0, static_cast<int>(i) - 1))]);
    double largest = 0;
    for (const std::size_t i : order) {
      const auto* x = rows.ptr<float>(static_cast<int>(i));
      const double gradient = labels[i] * model.margin(x) - 1;
      const double before = alpha[i];
      alpha[i] = std::clamp(before - gradient / diagonal[i], 0.0, cost);
      const double change = (alpha[i] - before) * labels[i];
      if (change == 0) continue;
      largest = std::max(largest, std::abs(change) * std::sqrt(diagonal[i]));
      for (std::size_t k = 0; k < width; ++k)
        model.weights[k] += static_cast<float>(change * static_cast<double>(x[k]));
      model.bias += static_cast<float>(change);
    }
    if (largest < 1e-5) break;
  }
  return model;
}

double PlattScaling::probability(double margin) const { return logistic(a * margin + b); }

PlattScaling fit_platt_scaling(const std::vector<double>& margins, const std::vector<int>& labels) {
  // Platt's targets avoid 0 and 1. Newton's method with a small ridge.
  const auto positives =
      static_cast<double>(std::count_if(labels.begin(), labels.end(), [](int y) { return y > 0; }));
  const double negatives = static_cast<double>(labels.size()) - positives;
  PlattScaling fit;
  for (int round = 0; round < 60; ++round) {
    double ga = 1e-3 * fit.a;
    double gb = 1e-3 * fit.b;
    double haa = 1e-3;
    double hab = 0;
    double hbb = 1e-3;
    for (std::size_t i = 0; i < margins.size(); ++i) {
      const double target = labels[i] > 0 ? (positives + 1) / (positives + 2) : 1 / (negatives + 2);
      const double p = fit.probability(margins[i]);
      const double w = std::max(1e-9, p * (1 - p));
      ga += (p - target) * margins[i];
      gb += p - target;
      haa += w * margins[i] * margins[i];
      hab += w * margins[i];
      hbb += w;
    }
    const double det = haa * hbb - hab * hab;
    const double da = (hbb * ga - hab * gb) / det;
    const double db = (haa * gb - hab * ga) / det;
    fit.a -= da;
    fit.b -= db;
    if (std::abs(da) + std::abs(db) < 1e-9) break;
  }
  return fit;
}

}  // namespace tarsier::plate
