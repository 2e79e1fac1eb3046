// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/network.h"

#include <vector>

// Residual networks (He et al., "Deep residual learning for image recognition", CVPR 2016) that map
// an image to a vector: inference on one CPU, single precision.
namespace tarsier::linalg {

// out = max(0, shortcut(x) + second(first(x))).
// If `first` has stride 1, the shortcut is x itself. If it has stride 2, the shortcut is the mean
// of 2 x 2 pixels (a last odd row or column is dropped); missing channels are zero. If
// second(first(x)) is one row or column smaller than the shortcut, zeros are added below or to the
// right of it.
struct ResidualBlock {
  Layer first;
  Layer second;
  [[nodiscard]] Shape output(const Shape& input) const;  // throws std::invalid_argument
};

// The stem convolution; a 3 x 3 maximum with stride 2 and without padding; the blocks; the mean of
// each channel; a linear map of these means.
struct ResidualNetwork {
  Layer stem;
  std::vector<ResidualBlock> blocks;
  Layer head;  // 1 x 1, without relu

  [[nodiscard]] int outputs() const { return head.out; }
  // Number of multiplications of one pass. Throws std::invalid_argument for a map that is too
  // small.
  [[nodiscard]] double cost(Shape input) const;
  // Throws std::invalid_argument if layers do not match or an array has a wrong size.
  void check() const;
};

// Buffers of a pass, reused from call to call; use one for each thread.
struct ResidualWorkspace {
  Workspace layer;
  std::vector<float> map;    // of the last block
  std::vector<float> inner;  // first(x)
  std::vector<float> outer;  // second(first(x))
  std::vector<float> next;
  std::vector<float> mean;
  std::vector<float> result;
};

// Runs the network on `input` (shape.size() numbers). The result, of network.outputs() numbers, is
// in workspace.result. Throws std::invalid_argument for a map that is too small or has the wrong
// number of channels. The result does not depend on threads.
const std::vector<float>& run(const ResidualNetwork& network, const float* input, Shape shape,
                              ResidualWorkspace& workspace);

}  // namespace tarsier::linalg
