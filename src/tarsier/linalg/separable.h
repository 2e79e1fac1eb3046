// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/network.h"

#include <vector>

// Networks of separable convolutions (Howard et al., "MobileNets: efficient convolutional neural
// networks for mobile vision applications", 2017) with leaky rectifiers: inference on one CPU,
// single precision.
namespace tarsier::linalg {

// depthwise   d[c][y][x] = sum w[c][v][u] in[c][y + v - 1][x + u - 1], zeros outside; skipped
//             without such weights
// mix         a convolution of stride 1 with its bias (1 x 1 after `depthwise`)
// act         max(x, slope x)
// pool        the maximum of 2 x 2 pixels with stride `pool`; pixels beyond the right and lower
//             edge are ignored. 0: none
struct SeparableStage {
  std::vector<float> depthwise;                          // channels x 3 x 3, or empty
  Layer mix;                                             // without relu
  float slope = 1;                                       // 0..1
  int pool = 0;                                          // 0..2
  [[nodiscard]] Shape output(const Shape& input) const;  // throws std::invalid_argument
};

struct SeparableNetwork {
  std::vector<SeparableStage> stages;

  // Throw std::invalid_argument for a map that is too small or has the wrong number of channels.
  [[nodiscard]] Shape output(Shape input) const;
  [[nodiscard]] double cost(Shape input) const;  // multiplications of one pass
  // Throws std::invalid_argument if stages do not match or an array has a wrong size.
  void check() const;
};

// Buffers of a pass, reused from call to call; use one for each thread.
struct SeparableWorkspace {
  Workspace layer;
  std::vector<float> map;
  std::vector<float> next;
};

// Runs the network on `input` (shape.size() numbers). The result, of shape network.output(shape),
// is in workspace.map. Throws the same exceptions as output(). The result does not depend on
// threads.
const std::vector<float>& run(const SeparableNetwork& network, const float* input, Shape shape,
                              SeparableWorkspace& workspace);

}  // namespace tarsier::linalg
