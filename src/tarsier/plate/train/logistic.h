// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

namespace tarsier::plate {

// Data of a logistic regression: rows of equal length, labels 0 or 1.
struct LogisticRows {
  std::vector<std::vector<double>> rows;
  std::vector<int> labels;
  void add(std::vector<double> row, bool label);
};

// Returns the w of p = 1 / (1 + exp(-w x)) that minimises sum_i -ln p(label_i | x_i) + sum_k
// ridge_k w_k^2 / 2, by Newton's method. The ridges keep w finite for separable data. Throws
// std::invalid_argument for no rows, rows of different lengths, or a wrong number of ridges.
[[nodiscard]] std::vector<double> fit_logistic(const LogisticRows& data,
                                               const std::vector<double>& ridges);

}  // namespace tarsier::plate
