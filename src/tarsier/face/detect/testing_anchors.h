// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/tensors.h"

#include <string>
#include <vector>

// A detector with hand-written weights: it detects bright cells as faces with the size of its first
// anchor.
namespace tarsier::face {

inline linalg::NamedTensor tensor_of(std::string name, std::vector<std::int64_t> shape) {
  std::size_t count = 1;
  for (const std::int64_t size : shape) count *= static_cast<std::size_t>(size);
  linalg::NamedTensor tensor;
  tensor.name = std::move(name);
  tensor.shape = std::move(shape);
  tensor.values.assign(count, 0.0F);
  return tensor;
}

inline linalg::NamedTensors bright_anchors() {
  linalg::NamedTensors tensors;
  tensors.push_back(tensor_of("conv0/filters", {3, 3, 3, 2}));
  for (int c = 0; c < 3; ++c)  // the centre pixel, a third of each colour, channel 0
    tensors.back().values[static_cast<std::size_t>(((1 * 3 + 1) * 3 + c) * 2)] = 1.0F / 3;
  tensors.push_back(tensor_of("conv0/bias", {2}));
  // Adds the mean that is subtracted: (117.001 + 114.697 + 97.404) / 3 / 255.
  tensors.back().values[0] = 0.430198F;
  for (int i = 1; i <= 5; ++i) {
    const std::string name = "conv" + std::to_string(i);
    tensors.push_back(tensor_of(name + "/depthwise_filter", {3, 3, 2, 1}));
    tensors.back().values[4 * 2] = 1;
    tensors.push_back(tensor_of(name + "/pointwise_filter", {1, 1, 2, 2}));
    tensors.back().values[0] = 1;
    tensors.push_back(tensor_of(name + "/bias", {2}));
  }
  tensors.push_back(tensor_of("conv8/filters", {1, 1, 2, 25}));
  tensors.back().values[4] = 20;  // white: 10, black: -10
  tensors.push_back(tensor_of("conv8/bias", {25}));
  for (std::size_t anchor = 0; anchor < 5; ++anchor) tensors.back().values[anchor * 5 + 4] = -10;
  return tensors;
}

}  // namespace tarsier::face
