// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

namespace tarsier::plate {

// What logistic regression is fitted to: rows of as many features, labels 0 or 1.
struct LogisticRows {
  std::vector<std::vector<double>> rows;
  std::vector<int> labels;
  void add(std::vector<double> row, bool label);
};

// The w of p = 1 / (1 + exp(-w x)) that minimises sum_i -ln p(label_i | x_i) + sum_k ridge_k w_k^2 / 2, by
// Newton's method. Ridges keep separable data finite. Throws std::invalid_argument without rows, and
// for rows of different lengths and another number of ridges.
[[nodiscard]] std::vector<double> fit_logistic(const LogisticRows& data,
                                               const std::vector<double>& ridges);

}  // namespace tarsier::plate
