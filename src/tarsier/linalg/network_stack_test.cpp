// SPDX-License-Identifier: MIT
#include "tarsier/linalg/network_stack.h"

#include "tarsier/linalg/testing_noise.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace tarsier::linalg {
namespace {

Network with_biases(Network network, Rng& rng) {
  initialize(network, rng);
  for (Layer& layer : network.layers)
    for (float& bias : layer.bias) bias = static_cast<float>(rng.normal(0.1, 0.1));
  return network;
}

// Borders of several widths, a dilation, both kinds of max pooling. The output has many pixels.
Network wide_network(Rng& rng) {
  Network network;
  network.layers = {convolution(2, 5, 3, 3), maximum(5, 2, 2),
                    convolution(5, 7, 3, 5), maximum(7, 1, 2),
                    convolution(7, 4, 3, 3), convolution(4, 3, 1, 1, false)};
  network.layers[4].dilation = 2;
  network.layers[4].pad_y = 2;
  network.layers[4].pad_x = 1;
  return with_biases(network, rng);
}

// Ends in fully connected layers.
Network narrow_network(Rng& rng) {
  Network network;
  network.layers = {convolution(2, 6, 3, 3), maximum(6, 2, 2), convolution(6, 9, 7, 10),
                    convolution(9, 3, 1, 1, false)};
  network.layers[2].pad_y = network.layers[2].pad_x = 0;
  return with_biases(network, rng);
}

class Stack : public testing::TestWithParam<Network (*)(Rng&)> {};

TEST_P(Stack, AgreesWithSingleMaps) {
  Rng rng(5);
  const Network network = GetParam()(rng);
  const Shape shape{2, 14, 20};
  StackWorkspace stacked;
  Workspace single_workspace;
  const std::size_t pixels = 14 * 20;
  for (const int count : {7, 1, 30}) {  // smaller and larger than the previous one
    const auto maps = static_cast<std::size_t>(count);
    const std::vector<float> input = noise(2 * maps * pixels, rng);
    const std::vector<float> result = run_stack(network, input.data(), shape, count, stacked);
    const Shape to = network.output(shape);
    const std::size_t plane = to.size() / static_cast<std::size_t>(to.channels);
    ASSERT_EQ(result.size(), maps * to.size());
    for (std::size_t i = 0; i < maps; ++i) {
      std::vector<float> one;
      for (std::size_t c = 0; c < 2; ++c) {
        const auto from = input.begin() + static_cast<std::ptrdiff_t>((c * maps + i) * pixels);
        one.insert(one.end(), from, from + static_cast<std::ptrdiff_t>(pixels));
      }
      const std::vector<float>& expected = run(network, one.data(), shape, single_workspace);
      for (std::size_t k = 0; k < expected.size(); ++k) {
        ASSERT_EQ(result[((k / plane) * maps + i) * plane + k % plane], expected[k])
            << "map " << i << " of " << count << ", number " << k;
      }
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Networks, Stack, testing::Values(&wide_network, &narrow_network));

TEST(StackOfMaps, RefusesStridesAndEmptyStacks) {
  Rng rng(5);
  Network network = wide_network(rng);
  StackWorkspace workspace;
  const std::vector<float> input(2 * 14 * 20);
  EXPECT_THROW((void)run_stack(network, input.data(), {2, 14, 20}, 0, workspace),
               std::invalid_argument);
  EXPECT_TRUE(can_stack(network));
  network.layers[0].stride = 2;
  EXPECT_FALSE(can_stack(network));
  EXPECT_THROW((void)run_stack(network, input.data(), {2, 14, 20}, 1, workspace),
               std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::linalg
