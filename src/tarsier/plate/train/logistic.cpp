// SPDX-License-Identifier: MIT
#include "tarsier/plate/train/logistic.h"

#include "tarsier/core/require.h"

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

std::vector<double> fit_logistic(const LogisticRows& data, const std::vector<double>& ridges) {
  TARSIER_REQUIRE(!data.rows.empty() && data.rows.size() == data.labels.size(),
                  "{} rows, {} labels", data.rows.size(), data.labels.size());
  const std::size_t count = data.rows.front().size();
  const int size = static_cast<int>(count);
  TARSIER_REQUIRE(ridges.size() == count, "{} ridges for {} features", ridges.size(), count);
  const cv::Mat ridge(ridges, true);
  cv::Mat w = cv::Mat::zeros(size, 1, CV_64F);
  for (int round = 0; round < 50; ++round) {
    cv::Mat hessian = cv::Mat::diag(ridge);
    cv::Mat slope = w.mul(ridge);
    for (std::size_t i = 0; i < data.rows.size(); ++i) {
      const std::vector<double>& x = data.rows[i];
      TARSIER_REQUIRE(x.size() == count, "row {} has {} features", i, x.size());
      double odds = 0;
      for (int k = 0; k < size; ++k) odds += w.at<double>(k) * x[static_cast<std::size_t>(k)];
      const double p = 1 / (1 + std::exp(-odds));
      for (int k = 0; k < size; ++k) {
        const double value = x[static_cast<std::size_t>(k)];
        slope.at<double>(k) += (p - data.labels[i]) * value;
        for (int j = 0; j < size; ++j)
          hessian.at<double>(k, j) += p * (1 - p) * value * x[static_cast<std::size_t>(j)];
      }
    }
    cv::Mat step;
    cv::solve(hessian, slope, step, cv::DECOMP_CHOLESKY);
    w -= step;
    if (cv::norm(step) < 1e-9) break;
  }
  return {w.begin<double>(), w.end<double>()};
}

}  // namespace tarsier::plate
