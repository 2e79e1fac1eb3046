// SPDX-License-Identifier: MIT
#include "tarsier/plate/train/logistic.h"

#include "tarsier/core/require.h"
#include "tarsier/core/statistics.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace tarsier::plate {

void LogisticRows::add(std::vector<double> row, bool label) {
  rows.push_back(std::move(row));
  labels.push_back(label ? 1 : 0);
}

namespace {

double odds_of(const std::vector<double>& row, const cv::Mat& w) {
  double odds = 0;
  for (std::size_t k = 0; k < row.size(); ++k) odds += w.at<double>(static_cast<int>(k)) * row[k];
  return odds;
}

// The objective.
double cost_of(const LogisticRows& data, const cv::Mat& w, const cv::Mat& ridge) {
  double cost = w.mul(w).dot(ridge) / 2;
  for (std::size_t i = 0; i < data.rows.size(); ++i) {
    const double odds = odds_of(data.rows[i], w) * (data.labels[i] == 1 ? 1 : -1);
    cost += odds > 0 ? std::log1p(std::exp(-odds)) : std::log1p(std::exp(odds)) - odds;
  }
  return cost;
}

}  // namespace

std::vector<double> fit_logistic(const LogisticRows& data, const std::vector<double>& ridges) {
  TARSIER_REQUIRE(!data.rows.empty() && data.rows.size() == data.labels.size(),
                  "{} rows, {} labels", data.rows.size(), data.labels.size());
  const std::size_t count = data.rows.front().size();
  const int size = static_cast<int>(count);
  TARSIER_REQUIRE(ridges.size() == count, "{} ridges for {} features", ridges.size(), count);
  for (std::size_t i = 0; i < data.rows.size(); ++i)
    TARSIER_REQUIRE(data.rows[i].size() == count, "row {} has {} features", i, data.rows[i].size());
  const cv::Mat ridge(ridges, true);
  cv::Mat w = cv::Mat::zeros(size, 1, CV_64F);
  double cost = cost_of(data, w, ridge);
  for (int round = 0; round < 50; ++round) {
    cv::Mat hessian = cv::Mat::diag(ridge);
    cv::Mat gradient = w.mul(ridge);
    for (std::size_t i = 0; i < data.rows.size(); ++i) {
      const std::vector<double>& x = data.rows[i];
      const double p = logistic(odds_of(x, w));
      for (int k = 0; k < size; ++k) {
        const double value = x[static_cast<std::size_t>(k)];
        gradient.at<double>(k) += (p - data.labels[i]) * value;
        for (int j = 0; j < size; ++j)
          hessian.at<double>(k, j) += p * (1 - p) * value * x[static_cast<std::size_t>(j)];
      }
    }
    cv::Mat step;
    cv::solve(hessian, gradient, step, cv::DECOMP_CHOLESKY);
    // A full step may be too long for separable data.
    double next = cost_of(data, w - step, ridge);
    for (int half = 0; half < 40 && !(next <= cost); ++half) {
      step = step * 0.5;
      next = cost_of(data, w - step, ridge);
    }
    if (!(next <= cost)) break;
    w -= step;
    cost = next;
    if (cv::norm(step) < 1e-9) break;
  }
  return {w.begin<double>(), w.end<double>()};
}

}  // namespace tarsier::plate
