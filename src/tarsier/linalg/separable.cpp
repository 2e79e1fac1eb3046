// SPDX-License-Identifier: MIT
#include "tarsier/linalg/separable.h"

#include "tarsier/core/require.h"
#include "tarsier/linalg/gather.h"

#include <algorithm>
#include <cstddef>
#include <utility>

namespace tarsier::linalg {
namespace {

constexpr int kTaps = 9;

// Adds weight[-1..1] times the neighbours of each of `width` pixels to `out`.
void add_row(const float* in, const float* weight, int width, float* out) {
  const float left = weight[0];
  const float center = weight[1];
  const float right = weight[2];
  if (width == 1) {
    out[0] += center * in[0];
    return;
  }
  out[0] += center * in[0] + right * in[1];
  for (int x = 1; x + 1 < width; ++x)
    out[x] += left * in[x - 1] + center * in[x] + right * in[x + 1];
  out[width - 1] += left * in[width - 2] + center * in[width - 1];
}

void convolve_depthwise(const std::vector<float>& weights, const float* input, const Shape& shape,
                        std::vector<float>& output) {
  output.assign(shape.size(), 0);
  const auto line = static_cast<std::ptrdiff_t>(shape.width);
  for (int c = 0; c < shape.channels; ++c) {
    const std::ptrdiff_t plane = static_cast<std::ptrdiff_t>(c) * shape.height * line;
    const float* kernel = weights.data() + static_cast<std::ptrdiff_t>(c) * kTaps;
    for (int y = 0; y < shape.height; ++y) {
      float* out = output.data() + plane + y * line;
      for (int v = std::max(0, 1 - y); v < std::min(3, shape.height + 1 - y); ++v)
        add_row(input + plane + (y + v - 1) * line, kernel + static_cast<std::ptrdiff_t>(v) * 3,
                shape.width, out);
    }
  }
}

Shape pooled(const Shape& from, int step) {
  if (step == 0) return from;
  return {from.channels, (from.height + step - 1) / step, (from.width + step - 1) / step};
}

// In place: output (y, x) needs only inputs at or after its position.
void take_maximum(std::vector<float>& map, const Shape& from, const Shape& to, int step) {
  float* out = map.data();
  for (int c = 0; c < to.channels; ++c) {
    const float* plane = map.data() + static_cast<std::ptrdiff_t>(c) * from.height * from.width;
    for (int y = 0; y < to.height; ++y) {
      const float* upper = plane + static_cast<std::ptrdiff_t>(y) * step * from.width;
      const float* lower = y * step + 1 < from.height ? upper + from.width : upper;
      for (int x = 0; x < to.width; ++x) {
        const int left = x * step;
        const int right = std::min(left + 1, from.width - 1);
        *out++ = std::max(std::max(upper[left], upper[right]), std::max(lower[left], lower[right]));
      }
    }
  }
  map.resize(to.size());
}

}  // namespace

Shape SeparableStage::output(const Shape& input) const { return pooled(mix.output(input), pool); }

Shape SeparableNetwork::output(Shape input) const {
  for (const SeparableStage& stage : stages) input = stage.output(input);
  return input;
}

double SeparableNetwork::cost(Shape input) const {
  double total = 0;
  for (const SeparableStage& stage : stages) {
    if (!stage.depthwise.empty()) total += static_cast<double>(input.size()) * kTaps;
    total += static_cast<double>(stage.mix.output(input).size()) * stage.mix.depth();
    input = stage.output(input);
  }
  return total;
}

void SeparableNetwork::check() const {
  TARSIER_REQUIRE(!stages.empty() && stages.size() <= 64, "{} stages", stages.size());
  int channels = stages.front().mix.in;
  for (const SeparableStage& stage : stages) {
    TARSIER_REQUIRE(
        stage.mix.kind == Layer::Kind::kConvolution && !stage.mix.relu && stage.mix.stride == 1,
        "a stage mixes by a convolution of stride {}", stage.mix.stride);
    Network single_layer;
    single_layer.layers = {stage.mix};
    single_layer.check();
    TARSIER_REQUIRE(stage.mix.in == channels, "{} channels for a stage of {}", channels,
                    stage.mix.in);
    TARSIER_REQUIRE(stage.depthwise.empty() ||
                        stage.depthwise.size() == static_cast<std::size_t>(channels) * kTaps,
                    "{} weights for 3 x 3 pixels of {} channels", stage.depthwise.size(), channels);
    TARSIER_REQUIRE(stage.slope >= 0 && stage.slope <= 1, "slope {}", stage.slope);
    TARSIER_REQUIRE(stage.pool >= 0 && stage.pool <= 2, "a maximum at every {}th pixel",
                    stage.pool);
    channels = stage.mix.out;
  }
}

const std::vector<float>& run(const SeparableNetwork& network, const float* input, Shape shape,
                              SeparableWorkspace& workspace) {
  (void)network.output(shape);
  SeparableWorkspace& w = workspace;
  const float* source = input;
  for (const SeparableStage& stage : network.stages) {
    if (!stage.depthwise.empty()) {
      convolve_depthwise(stage.depthwise, source, shape, w.next);
      std::swap(w.map, w.next);
      source = w.map.data();
    }
    run_layer(stage.mix, source, shape, w.layer, w.next);
    std::swap(w.map, w.next);
    if (stage.slope < 1)
      for (float& value : w.map) value = std::max(value, stage.slope * value);
    const Shape mixed = stage.mix.output(shape);
    shape = pooled(mixed, stage.pool);
    if (stage.pool > 0) take_maximum(w.map, mixed, shape, stage.pool);
    source = w.map.data();
  }
  return w.map;
}

}  // namespace tarsier::linalg
