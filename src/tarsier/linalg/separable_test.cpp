// SPDX-License-Identifier: MIT
#include "tarsier/linalg/separable.h"

#include "tarsier/core/rng.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <vector>

namespace tarsier::linalg {
namespace {

std::vector<float> random_numbers(Rng& rng, std::size_t count) {
  std::vector<float> values(count);
  for (float& value : values) value = static_cast<float>(rng.normal(0, 1));
  return values;
}

SeparableStage random_stage(Rng& rng, int in, int out, int pool) {
  SeparableStage stage;
  stage.depthwise = random_numbers(rng, static_cast<std::size_t>(in) * 9);
  stage.mix = convolution(in, out, 1, 1, false);
  stage.mix.weights = random_numbers(rng, stage.mix.weights.size());
  stage.mix.bias = random_numbers(rng, stage.mix.bias.size());
  stage.slope = 0.1F;
  stage.pool = pool;
  return stage;
}

// The direct definition, pixel by pixel.
std::vector<double> defined(const SeparableStage& stage, const std::vector<float>& input,
                            Shape shape) {
  const auto at = [&](int c, int y, int x) {
    if (y < 0 || x < 0 || y >= shape.height || x >= shape.width) return 0.0;
    return static_cast<double>(
        input[static_cast<std::size_t>((c * shape.height + y) * shape.width + x)]);
  };
  const auto mixed = [&](int o, int y, int x) {
    double sum = stage.mix.bias[static_cast<std::size_t>(o)];
    for (int c = 0; c < shape.channels; ++c) {
      double deep = 0;
      for (int v = 0; v < 3; ++v)
        for (int u = 0; u < 3; ++u)
          deep += stage.depthwise[static_cast<std::size_t>(c * 9 + v * 3 + u)] *
                  at(c, y + v - 1, x + u - 1);
      sum += stage.mix.weights[static_cast<std::size_t>(o * shape.channels + c)] * deep;
    }
    return std::max(sum, stage.slope * sum);
  };
  std::vector<double> out;
  const Shape to = stage.output(shape);
  for (int o = 0; o < to.channels; ++o)
    for (int y = 0; y < to.height; ++y)
      for (int x = 0; x < to.width; ++x) {
        if (stage.pool == 0) {
          out.push_back(mixed(o, y, x));
          continue;
        }
        double best = -std::numeric_limits<double>::infinity();
        for (int v = y * stage.pool; v < std::min(shape.height, y * stage.pool + 2); ++v)
          for (int u = x * stage.pool; u < std::min(shape.width, x * stage.pool + 2); ++u)
            best = std::max(best, mixed(o, v, u));
        out.push_back(best);
      }
  return out;
}

TEST(Separable, AgreesWithItsDefinitionForAllShapes) {
  Rng rng(1);
  SeparableWorkspace workspace;
  for (const Shape shape : {Shape{3, 7, 9}, Shape{5, 1, 6}, Shape{2, 6, 1}, Shape{4, 12, 40}}) {
    for (int pool = 0; pool <= 2; ++pool) {
      SeparableNetwork network;
      network.stages = {random_stage(rng, shape.channels, 6, pool)};
      network.check();
      const std::vector<float> input = random_numbers(rng, shape.size());
      const std::vector<double> expected = defined(network.stages[0], input, shape);
      const std::vector<float>& result = run(network, input.data(), shape, workspace);
      ASSERT_EQ(result.size(), expected.size());
      for (std::size_t i = 0; i < expected.size(); ++i)
        ASSERT_NEAR(result[i], expected[i], 1e-4) << "number " << i << ", pool " << pool;
    }
  }
}

TEST(Separable, StagesRunInOrder) {
  Rng rng(2);
  const Shape shape{3, 9, 11};
  SeparableNetwork both;
  both.stages = {random_stage(rng, 3, 4, 2), random_stage(rng, 4, 2, 1)};
  SeparableNetwork first;
  first.stages = {both.stages[0]};
  SeparableNetwork second;
  second.stages = {both.stages[1]};
  const std::vector<float> input = random_numbers(rng, shape.size());
  SeparableWorkspace workspace;
  const std::vector<float> between = run(first, input.data(), shape, workspace);
  const std::vector<float> separate = run(second, between.data(), first.output(shape), workspace);
  EXPECT_EQ(run(both, input.data(), shape, workspace), separate);
  EXPECT_EQ(both.output(shape), (Shape{2, 5, 6}));
  EXPECT_GT(both.cost(shape), 0);
}

TEST(Separable, RefusesInconsistentStages) {
  Rng rng(3);
  const auto broken = [&](auto change) {
    SeparableNetwork network;
    network.stages = {random_stage(rng, 3, 4, 2), random_stage(rng, 4, 2, 1)};
    network.check();
    change(network);
    EXPECT_THROW(network.check(), std::invalid_argument);
  };
  broken([](SeparableNetwork& n) { n.stages.clear(); });
  broken([](SeparableNetwork& n) { n.stages[1].depthwise.pop_back(); });
  broken([](SeparableNetwork& n) { n.stages[0].mix.bias.pop_back(); });
  broken([](SeparableNetwork& n) { n.stages[0].mix.relu = true; });
  broken([](SeparableNetwork& n) { n.stages[0].slope = 2; });
  broken([](SeparableNetwork& n) { n.stages[0].pool = 3; });
  broken([](SeparableNetwork& n) { std::swap(n.stages[0], n.stages[1]); });
  SeparableNetwork network;
  network.stages = {random_stage(rng, 3, 4, 2)};
  SeparableWorkspace workspace;
  const std::vector<float> input(4 * 5 * 5);
  EXPECT_THROW((void)run(network, input.data(), {4, 5, 5}, workspace), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::linalg
