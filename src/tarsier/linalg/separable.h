// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/network.h"

#include <vector>

// Networks of separable convolutions (Howard et al., "MobileNets: efficient convolutional neural
// networks for mobile vision applications", 2017) with leaky rectifiers: inference on one CPU,
// single precision.
namespace tarsier::linalg {

// depthwise   d[c][y][x] = sum w[c][v][u] in[c][y + v - 1][x + u - 1], zeros outside; left out
//             where there are no such weights
// mix         a convolution of stride 1 with its bias (1 x 1 after `depthwise`)
// act         max(x, slope x)
// pool        the maximum of 2 x 2 at every `pool`-th pixel; what lies beyond the right and lower
//             edge does not count. 0: none
struct SeparableStage {
  std::vector<float> depthwise;                          // channels x 3 x 3, or empty
  Layer mix;                                             // without max(0, .)
  float slope = 1;                                       // 0..1
  int pool = 0;                                          // 0..2
  [[nodiscard]] Shape output(const Shape& input) const;  // throws std::invalid_argument
};

struct SeparableNetwork {
  std::vector<SeparableStage> stages;

  // Throw std::invalid_argument for a map that is too small or of other channels.
  [[nodiscard]] Shape output(Shape input) const;
  [[nodiscard]] double cost(Shape input) const;  // multiplications of one pass
  // Throws std::invalid_argument where stages do not fit together or arrays have a wrong size.
  void check() const;
};

// Buffers of a pass; reused from call to call. One for each thread.
struct SeparableWorkspace {
  Workspace layer;
  std::vector<float> map;
  std::vector<float> next;
};

// Runs the network on `input` (shape.size() numbers). The result, of shape network.output(shape),
// lies in workspace.map. Throws as output(). The numbers do not depend on threads.
const std::vector<float>& run(const SeparableNetwork& network, const float* input, Shape shape,
                              SeparableWorkspace& workspace);

}  // namespace tarsier::linalg
