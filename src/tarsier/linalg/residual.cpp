// SPDX-License-Identifier: MIT
#include "tarsier/linalg/residual.h"

#include "tarsier/core/require.h"
#include "tarsier/linalg/gather.h"

#include <algorithm>
#include <cstddef>

namespace tarsier::linalg {
namespace {

constexpr int kPoolKernel = 3;
constexpr int kPoolStride = 2;

Shape pooled(const Shape& from) {
  TARSIER_REQUIRE(from.height >= kPoolKernel && from.width >= kPoolKernel,
                  "a map of {}x{} is too small here", from.width, from.height);
  return {from.channels, (from.height - kPoolKernel) / kPoolStride + 1,
          (from.width - kPoolKernel) / kPoolStride + 1};
}

void take_maximum(const float* input, const Shape& from, const Shape& to, float* output) {
  for (int c = 0; c < to.channels; ++c) {
    const float* plane = input + static_cast<std::ptrdiff_t>(c) * from.height * from.width;
    for (int y = 0; y < to.height; ++y) {
      const float* rows = plane + static_cast<std::ptrdiff_t>(y * kPoolStride) * from.width;
      for (int x = 0; x < to.width; ++x) {
        const float* corner = rows + static_cast<std::ptrdiff_t>(x) * kPoolStride;
        float best = *corner;
        for (int v = 0; v < kPoolKernel; ++v)
          for (int u = 0; u < kPoolKernel; ++u)
            best = std::max(best, corner[static_cast<std::ptrdiff_t>(v) * from.width + u]);
        *output++ = best;
      }
    }
  }
}

// Shape of the shortcut of a block with stride 2, with the channels of the block's output.
Shape mean_shortcut_shape(const Shape& from, int channels) {
  return {channels, from.height / 2, from.width / 2};
}

// output = max(0, means of 2 x 2 of `input` + `inner`), see ResidualBlock.
void add_mean_shortcut(const float* input, const Shape& from, const std::vector<float>& inner,
                       const Shape& inside, const Shape& to, std::vector<float>& output) {
  output.resize(to.size());
  float* out = output.data();
  for (int c = 0; c < to.channels; ++c) {
    for (int y = 0; y < to.height; ++y) {
      for (int x = 0; x < to.width; ++x) {
        float value = 0;
        if (c < from.channels) {
          const float* corner =
              input +
              (static_cast<std::ptrdiff_t>(c) * from.height + static_cast<std::ptrdiff_t>(2) * y) *
                  from.width +
              static_cast<std::ptrdiff_t>(2) * x;
          value = 0.25F * (corner[0] + corner[1] + corner[from.width] + corner[from.width + 1]);
        }
        if (y < inside.height && x < inside.width)
          value += inner[(static_cast<std::size_t>(c) * static_cast<std::size_t>(inside.height) +
                          static_cast<std::size_t>(y)) *
                             static_cast<std::size_t>(inside.width) +
                         static_cast<std::size_t>(x)];
        *out++ = std::max(0.0F, value);
      }
    }
  }
}

void check_convolution(const Layer& layer) {
  TARSIER_REQUIRE(layer.kind == Layer::Kind::kConvolution, "a maximum in place of a convolution");
  Network single_layer;
  single_layer.layers = {layer};
  single_layer.check();
}

}  // namespace

Shape ResidualBlock::output(const Shape& input) const {
  const Shape inside = second.output(first.output(input));
  if (first.stride == 1) {
    TARSIER_REQUIRE(inside == input, "a block of stride 1 makes {}x{}x{} of {}x{}x{}",
                    inside.channels, inside.height, inside.width, input.channels, input.height,
                    input.width);
    return input;
  }
  const Shape out = mean_shortcut_shape(input, inside.channels);
  TARSIER_REQUIRE(inside.channels >= input.channels, "{} channels become {}", input.channels,
                  inside.channels);
  TARSIER_REQUIRE(out.height >= 1 && out.width >= 1 && inside.height <= out.height &&
                      inside.width <= out.width && inside.height >= out.height - 1 &&
                      inside.width >= out.width - 1,
                  "{}x{} beside a shortcut of {}x{}", inside.height, inside.width, out.height,
                  out.width);
  return out;
}

double ResidualNetwork::cost(Shape input) const {
  const auto of = [](const Layer& layer, const Shape& to) {
    return static_cast<double>(to.size()) * layer.depth();
  };
  Shape shape = stem.output(input);
  double total = of(stem, shape);
  shape = pooled(shape);
  for (const ResidualBlock& block : blocks) {
    const Shape inner = block.first.output(shape);
    total += of(block.first, inner) + of(block.second, block.second.output(inner));
    shape = block.output(shape);
  }
  return total + static_cast<double>(head.out) * head.in;
}

void ResidualNetwork::check() const {
  check_convolution(stem);
  TARSIER_REQUIRE(!blocks.empty() && blocks.size() <= 256, "{} blocks", blocks.size());
  int channels = stem.out;
  for (const ResidualBlock& block : blocks) {
    check_convolution(block.first);
    check_convolution(block.second);
    TARSIER_REQUIRE(block.first.stride <= 2 && block.second.stride == 1, "strides {} and {}",
                    block.first.stride, block.second.stride);
    TARSIER_REQUIRE(block.first.in == channels && block.first.out == block.second.in,
                    "{} channels, then {} -> {}, {} -> {}", channels, block.first.in,
                    block.first.out, block.second.in, block.second.out);
    TARSIER_REQUIRE(block.first.stride == 2 || block.second.out == channels,
                    "a block of stride 1 makes {} channels of {}", block.second.out, channels);
    TARSIER_REQUIRE(block.second.out >= channels, "{} channels become {}", channels,
                    block.second.out);
    channels = block.second.out;
  }
  check_convolution(head);
  TARSIER_REQUIRE(head.in == channels && head.depth() == channels && !head.relu &&
                      head.pad_x == 0 && head.pad_y == 0 && head.stride == 1,
                  "a head of {} x {} x {} for {} channels", head.in, head.kernel_y, head.kernel_x,
                  channels);
}

const std::vector<float>& run(const ResidualNetwork& network, const float* input, Shape shape,
                              ResidualWorkspace& workspace) {
  ResidualWorkspace& w = workspace;
  const Shape wide = network.stem.output(shape);
  run_layer(network.stem, input, shape, w.layer, w.inner);
  Shape at = pooled(wide);
  w.map.resize(at.size());
  take_maximum(w.inner.data(), wide, at, w.map.data());
  for (const ResidualBlock& block : network.blocks) {
    const Shape to = block.output(at);
    const Shape inner = block.first.output(at);
    run_layer(block.first, w.map.data(), at, w.layer, w.inner);
    run_layer(block.second, w.inner.data(), inner, w.layer, w.outer);
    if (block.first.stride == 1) {
      for (std::size_t i = 0; i < w.map.size(); ++i)
        w.map[i] = std::max(0.0F, w.map[i] + w.outer[i]);
    } else {
      add_mean_shortcut(w.map.data(), at, w.outer, block.second.output(inner), to, w.next);
      std::swap(w.map, w.next);
    }
    at = to;
  }
  const auto pixels = static_cast<std::size_t>(at.height) * static_cast<std::size_t>(at.width);
  w.mean.resize(static_cast<std::size_t>(at.channels));
  for (std::size_t c = 0; c < w.mean.size(); ++c) {
    float sum = 0;
    for (std::size_t i = 0; i < pixels; ++i) sum += w.map[c * pixels + i];
    w.mean[c] = sum / static_cast<float>(pixels);
  }
  run_layer(network.head, w.mean.data(), {at.channels, 1, 1}, w.layer, w.result);
  return w.result;
}

}  // namespace tarsier::linalg
