// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"

#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::plate {

// margin(x) = weights . x + bias
struct LinearModel {
  std::vector<float> weights;
  float bias = 0;
  [[nodiscard]] double margin(const float* x) const;
};

// Support vector machine with the linear kernel and hinge loss,
//   min 1/2 |w|^2 + cost sum max(0, 1 - y (w . x + b)),
// by dual coordinate descent (Hsieh et al., "A dual coordinate descent method for large-scale
// linear SVM", ICML 2008). The bias is the weight of a constant input 1. `rows`: CV_32F, one
// example per row; `labels`: 1 or -1. `iterations`: maximum number of passes over the examples.
// `cost` > 0.
[[nodiscard]] LinearModel train_linear_svm(const cv::Mat& rows, const std::vector<int>& labels,
                                           double cost, int iterations, Rng rng);

// Probability of the class +1 at a margin m: 1 / (1 + exp(-(a m + b))), fitted to margins with
// known labels (Platt, 1999).
struct PlattScaling {
  double a = 1;
  double b = 0;
  [[nodiscard]] double probability(double margin) const;
};
[[nodiscard]] PlattScaling fit_platt_scaling(const std::vector<double>& margins,
                                             const std::vector<int>& labels);

}  // namespace tarsier::plate
