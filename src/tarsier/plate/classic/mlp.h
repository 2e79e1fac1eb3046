// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/rng.h"

#include <opencv2/core/mat.hpp>

#include <stop_token>
#include <vector>

namespace tarsier::plate {

// One hidden layer; tanh in the hidden layer and at the outputs. The largest output gives the
// class.
struct Mlp {
  int inputs = 0;
  int hidden = 0;
  int outputs = 0;
  std::vector<float> mean;            // of the inputs; subtracted first
  std::vector<float> scale;           // standard deviation of the inputs; the divisor
  std::vector<float> hidden_weights;  // hidden x (inputs + 1); the last column is the bias
  std::vector<float> output_weights;  // outputs x (hidden + 1)

  [[nodiscard]] std::vector<float> run(const float* x) const;  // each -1..1
};

struct MlpOptions {
  int hidden = 20;
  int iterations = 100;

  [[nodiscard]] OptionFields fields() {
    return {{"hidden", hidden, range(1, 1000), "--neurons", "number of hidden neurons of the mlp"},
            {"iterations", iterations, range(1, 100000)}};
  }
  void check() const { check_fields(*this); }
};

// Minimises the squared error against targets of +-1 by resilient backpropagation (Riedmiller and
// Braun, ICNN 1993) with full batches. `rows`: CV_32F; `labels`: 0..outputs-1. Throws Interrupted.
[[nodiscard]] Mlp train_mlp(const cv::Mat& rows, const std::vector<int>& labels, int outputs,
                            const MlpOptions& options, Rng rng, const std::stop_token& stop = {});

}  // namespace tarsier::plate
