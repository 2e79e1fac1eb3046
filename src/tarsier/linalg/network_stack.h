// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/network.h"

#include <cstddef>
#include <vector>

// Runs one network on many small maps of the same size at once. The maps are stacked vertically
// with their zero padding between them. One matrix product then covers all of them: its panels are
// full, and no layer's input is copied to add the padding.
namespace tarsier::linalg {

// Buffers, reused from call to call; use one for each thread.
struct StackWorkspace {
  std::vector<float> maps[2];  // of a layer and of the next one
  std::vector<float> result;
  std::vector<float> columns;
  std::vector<float> product;
  std::vector<std::ptrdiff_t> offsets;
};

// Whether run_stack() supports the network: every convolution has stride 1.
[[nodiscard]] bool can_stack(const Network& network);

// Runs the network on `count` maps of `shape` each. Layout: channel by channel, and map by map in
// each channel: input[((c count + i) height + y) width + x]. The result has the same layout, each
// map of shape network.output(shape), and is valid until the next call. The numbers equal those of
// run(), whatever else is in the stack. Throws std::invalid_argument if can_stack() is false or
// count < 1.
const std::vector<float>& run_stack(const Network& network, const float* input, Shape shape,
                                    int count, StackWorkspace& workspace);

}  // namespace tarsier::linalg
