// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/network.h"

#include <cstddef>
#include <vector>

// One network on many small maps of the same size at once. The maps lie under each other with
// their borders of zeros between them, so that a matrix product runs over all of them: its panels
// are full, and no layer's input is copied to get its border.
namespace tarsier::linalg {

// Buffers; reused from call to call. One for each thread.
struct StackWorkspace {
  std::vector<float> maps[2];  // of a layer and of the next
  std::vector<float> result;
  std::vector<float> columns;
  std::vector<float> product;
  std::vector<std::ptrdiff_t> offsets;
};

// True where run_stack() takes the network: every convolution has a stride of 1.
[[nodiscard]] bool can_stack(const Network& network);

// Runs the network on `count` maps of `shape` each; channel after channel, in each of them map
// after map: input[((c count + i) height + y) width + x]. The result is laid out in the same way,
// each map of shape network.output(shape), and stays until the next call. A map's numbers are those
// of run(), whatever else is in the stack. Throws std::invalid_argument where can_stack() does not
// hold, or count < 1.
const std::vector<float>& run_stack(const Network& network, const float* input, Shape shape,
                                    int count, StackWorkspace& workspace);

}  // namespace tarsier::linalg
