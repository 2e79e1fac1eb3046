// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/network.h"

#include <vector>

// Residual networks (He et al., "Deep residual learning for image recognition", CVPR 2016) that
// turn a map into a vector: inference on one CPU, single precision.
namespace tarsier::linalg {

// out = max(0, shortcut(x) + second(first(x))).
// `first` of stride 1: the shortcut is x itself. Of stride 2: the means of 2 x 2 pixels (a last odd
// row or column is left out); channels that x lacks are zeros, and where second(first(x)) is a row
// or column short of the shortcut, zeros stand below or to the right of it.
struct ResidualBlock {
  Layer first;
  Layer second;
  [[nodiscard]] Shape output(const Shape& input) const;  // throws std::invalid_argument
};

// A convolution; the maximum over 3 x 3 pixels at every second one, without a border; blocks; the
// mean of each channel; a linear map of these.
struct ResidualNetwork {
  Layer stem;
  std::vector<ResidualBlock> blocks;
  Layer head;  // 1 x 1, without max(0, .)

  [[nodiscard]] int outputs() const { return head.out; }
  // Multiplications of one pass. Throws std::invalid_argument for a map that is too small.
  [[nodiscard]] double cost(Shape input) const;
  // Throws std::invalid_argument where layers do not fit together or arrays have a wrong size.
  void check() const;
};

// Buffers of a pass; reused from call to call. One for each thread.
struct ResidualWorkspace {
  Workspace layer;
  std::vector<float> map;    // of the last block
  std::vector<float> inner;  // first(x)
  std::vector<float> outer;  // second(first(x))
  std::vector<float> next;
  std::vector<float> mean;
  std::vector<float> result;
};

// Runs the network on `input` (shape.size() numbers). The result, of network.outputs() numbers,
// lies in workspace.result. Throws std::invalid_argument for a map that is too small or of other
// channels. The numbers do not depend on threads.
const std::vector<float>& run(const ResidualNetwork& network, const float* input, Shape shape,
                              ResidualWorkspace& workspace);

}  // namespace tarsier::linalg
