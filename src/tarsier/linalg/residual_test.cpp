// SPDX-License-Identifier: MIT
#include "tarsier/linalg/residual.h"

#include "tarsier/linalg/testing_noise.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <vector>

namespace tarsier::linalg {
namespace {

// Plain loops in double precision, layer by layer: the reference for residual.cpp.
struct Map {
  Shape shape;
  std::vector<double> values;
  [[nodiscard]] double at(int c, int y, int x) const {
    if (y < 0 || x < 0 || y >= shape.height || x >= shape.width || c >= shape.channels) return 0;
    return values[(static_cast<std::size_t>(c) * static_cast<std::size_t>(shape.height) +
                   static_cast<std::size_t>(y)) *
                      static_cast<std::size_t>(shape.width) +
                  static_cast<std::size_t>(x)];
  }
};

template <typename Value>
Map map_of(const Shape& shape, const Value& value) {
  Map out{shape, {}};
  for (int c = 0; c < shape.channels; ++c)
    for (int y = 0; y < shape.height; ++y)
      for (int x = 0; x < shape.width; ++x) out.values.push_back(value(c, y, x));
  return out;
}

Map convolved(const Layer& layer, const Map& in) {
  return map_of(layer.output(in.shape), [&](int o, int y, int x) {
    double sum = layer.bias[static_cast<std::size_t>(o)];
    std::size_t at = static_cast<std::size_t>(o) * static_cast<std::size_t>(layer.depth());
    for (int i = 0; i < layer.in; ++i)
      for (int v = 0; v < layer.kernel_y; ++v)
        for (int u = 0; u < layer.kernel_x; ++u)
          sum += layer.weights[at++] *
                 in.at(i, y * layer.stride + v - layer.pad_y, x * layer.stride + u - layer.pad_x);
    return layer.relu ? std::max(0.0, sum) : sum;
  });
}

std::vector<double> plain(const ResidualNetwork& network, const Map& in) {
  const Map wide = convolved(network.stem, in);
  Map map =
      map_of({wide.shape.channels, (wide.shape.height - 3) / 2 + 1, (wide.shape.width - 3) / 2 + 1},
             [&](int c, int y, int x) {
               double best = -1e30;
               for (int v = 0; v < 3; ++v)
                 for (int u = 0; u < 3; ++u)
                   best = std::max(best, wide.at(c, 2 * y + v, 2 * x + u));
               return best;
             });
  for (const ResidualBlock& block : network.blocks) {
    const Map inside = convolved(block.second, convolved(block.first, map));
    const bool half = block.first.stride == 2;
    const Shape shape{inside.shape.channels, half ? map.shape.height / 2 : map.shape.height,
                      half ? map.shape.width / 2 : map.shape.width};
    map = map_of(shape, [&](int c, int y, int x) {
      const double shortcut =
          half ? 0.25 * (map.at(c, 2 * y, 2 * x) + map.at(c, 2 * y, 2 * x + 1) +
                         map.at(c, 2 * y + 1, 2 * x) + map.at(c, 2 * y + 1, 2 * x + 1))
               : map.at(c, y, x);
      return std::max(0.0, shortcut + inside.at(c, y, x));
    });
  }
  const Map mean = map_of({map.shape.channels, 1, 1}, [&](int c, int, int) {
    double sum = 0;
    for (int y = 0; y < map.shape.height; ++y)
      for (int x = 0; x < map.shape.width; ++x) sum += map.at(c, y, x);
    return sum / (map.shape.height * map.shape.width);
  });
  return convolved(network.head, mean).values;
}

Layer random_layer(int in, int out, int kernel, int stride, bool relu, Rng& rng) {
  Layer layer = convolution(in, out, kernel, kernel, relu);
  layer.stride = stride;
  if (stride > 1) layer.pad_x = layer.pad_y = 0;
  const double sigma = std::sqrt(2.0 / layer.depth());
  for (float& weight : layer.weights) weight = static_cast<float>(rng.normal(0, sigma));
  for (float& bias : layer.bias) bias = static_cast<float>(rng.normal(0, 0.1));
  return layer;
}

ResidualBlock random_block(int in, int out, int stride, Rng& rng) {
  return {random_layer(in, out, 3, stride, true, rng), random_layer(out, out, 3, 1, false, rng)};
}

// Every kind of block, on maps of odd and even sizes. Some pad the shortcut with a row and column
// of zeros (for 95 x 95: 22 -> 10 beside 11, then 5 and 2).
ResidualNetwork random_network(Rng& rng) {
  ResidualNetwork network;
  network.stem = random_layer(3, 4, 7, 2, true, rng);
  network.blocks = {random_block(4, 4, 1, rng), random_block(4, 8, 2, rng),
                    random_block(8, 8, 1, rng), random_block(8, 16, 2, rng),
                    random_block(16, 16, 2, rng)};
  network.head = convolution(16, 10, 1, 1, false);
  for (float& weight : network.head.weights) weight = static_cast<float>(rng.normal(0, 0.3));
  network.check();
  return network;
}

TEST(Residual, AgreesWithPlainLoops) {
  Rng rng(5);
  const ResidualNetwork network = random_network(rng);
  ResidualWorkspace workspace;
  for (const Shape shape : {Shape{3, 95, 95}, Shape{3, 90, 61}, Shape{3, 77, 100}}) {
    const std::vector<float> input = noise(shape.size(), rng);
    const std::vector<double> expected =
        plain(network, {shape, std::vector<double>(input.begin(), input.end())});
    const std::vector<float>& result = run(network, input.data(), shape, workspace);
    ASSERT_EQ(result.size(), expected.size());
    double largest = 0;
    for (std::size_t i = 0; i < result.size(); ++i) {
      EXPECT_NEAR(result[i], expected[i], 1e-4) << shape.height << "x" << shape.width;
      largest = std::max(largest, std::abs(expected[i]));
    }
    EXPECT_GT(largest, 0.05);
  }
}

TEST(Residual, ABlockIsItsShortcutWhereItsConvolutionsAreZero) {
  Rng rng(6);
  ResidualNetwork network = random_network(rng);
  const Shape shape{3, 95, 95};
  const std::vector<float> input = noise(shape.size(), rng);
  for (ResidualBlock* block : {&network.blocks[0], &network.blocks[2]}) {
    std::fill(block->second.weights.begin(), block->second.weights.end(), 0.0F);
    std::fill(block->second.bias.begin(), block->second.bias.end(), 0.0F);
  }
  ResidualWorkspace workspace;
  const std::vector<float> with = run(network, input.data(), shape, workspace);
  network.blocks.erase(network.blocks.begin() + 2);
  network.blocks.erase(network.blocks.begin());
  EXPECT_EQ(run(network, input.data(), shape, workspace), with);
}

TEST(Residual, AReusedWorkspaceDoesNotChangeTheResult) {
  Rng rng(7);
  const ResidualNetwork network = random_network(rng);
  const Shape small{3, 95, 95};
  const Shape large{3, 101, 120};
  const std::vector<float> input = noise(small.size(), rng);
  const std::vector<float> other = noise(large.size(), rng);
  ResidualWorkspace fresh;
  ResidualWorkspace used;
  (void)run(network, other.data(), large, used);
  EXPECT_EQ(run(network, input.data(), small, used), run(network, input.data(), small, fresh));
}

TEST(Residual, CountsItsMultiplications) {
  Rng rng(8);
  ResidualNetwork network = random_network(rng);
  network.blocks.resize(1);
  network.head = convolution(4, 10, 1, 1, false);
  // 47 -> 21 by the stem, 10 by the max pooling.
  EXPECT_DOUBLE_EQ(network.cost({3, 47, 47}),
                   21.0 * 21 * 4 * 147 + 2 * 10.0 * 10 * 4 * 36 + 4 * 10);
}

TEST(Residual, RefusesInconsistentBlocks) {
  Rng rng(9);
  const ResidualNetwork good = random_network(rng);
  ResidualWorkspace workspace;
  const std::vector<float> input = noise(Shape{3, 95, 95}.size(), rng);
  EXPECT_THROW((void)run(good, input.data(), {3, 12, 95}, workspace), std::invalid_argument);
  EXPECT_THROW((void)run(good, input.data(), {2, 95, 95}, workspace), std::invalid_argument);

  ResidualNetwork bad = good;
  bad.blocks.clear();
  EXPECT_THROW(bad.check(), std::invalid_argument);
  bad = good;
  bad.blocks.pop_back();
  bad.blocks.pop_back();  // 8 channels, but the head needs 16
  EXPECT_THROW(bad.check(), std::invalid_argument);
  bad = good;
  bad.blocks[0].first.weights.pop_back();
  EXPECT_THROW(bad.check(), std::invalid_argument);
  bad = good;
  bad.blocks[0].second.stride = 2;
  EXPECT_THROW(bad.check(), std::invalid_argument);
  bad = good;
  bad.blocks[0] = random_block(4, 8, 1, rng);  // more channels without a stride
  EXPECT_THROW(bad.check(), std::invalid_argument);
  bad = good;
  bad.head.relu = true;
  EXPECT_THROW(bad.check(), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::linalg
