// SPDX-License-Identifier: MIT
#include "tarsier/linalg/network.h"

#include "tarsier/core/require.h"
#include "tarsier/linalg/gather.h"
#include "tarsier/linalg/gemm.h"

#include <opencv2/core.hpp>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::linalg {
namespace {

constexpr int kParallelPanels = 16;  // fewer are not worth another thread

void check_layer(const Layer& layer) {
  const auto within = [](int value, int low, int high) { return value >= low && value <= high; };
  TARSIER_REQUIRE(within(layer.in, 1, 4096) && within(layer.out, 1, 4096), "{} -> {} channels",
                  layer.in, layer.out);
  TARSIER_REQUIRE(within(layer.kernel_y, 1, 64) && within(layer.kernel_x, 1, 64),
                  "a kernel of {} x {}", layer.kernel_x, layer.kernel_y);
  TARSIER_REQUIRE(within(layer.stride, 1, 8) && within(layer.dilation, 1, 8),
                  "stride {}, dilation {}", layer.stride, layer.dilation);
  TARSIER_REQUIRE(within(layer.pad_y, 0, 64) && within(layer.pad_x, 0, 64), "padding {} x {}",
                  layer.pad_x, layer.pad_y);
  if (layer.kind == Layer::Kind::kMaximum) {
    TARSIER_REQUIRE(layer.in == layer.out, "a maximum keeps its channels, not {} -> {}", layer.in,
                    layer.out);
    return;
  }
  // More padding would only add a border of biases, and maps that grow from layer to layer.
  const auto reach = [&](int kernel) { return (layer.dilation * (kernel - 1) + 1) / 2; };
  TARSIER_REQUIRE(layer.pad_y <= reach(layer.kernel_y) && layer.pad_x <= reach(layer.kernel_x),
                  "padding {} x {} for a kernel of {} x {}, dilation {}", layer.pad_x, layer.pad_y,
                  layer.kernel_x, layer.kernel_y, layer.dilation);
  const std::size_t weights =
      static_cast<std::size_t>(layer.out) * static_cast<std::size_t>(layer.depth());
  TARSIER_REQUIRE(
      layer.weights.size() == weights && layer.bias.size() == static_cast<std::size_t>(layer.out),
      "{} weights and {} biases, expected {} and {}", layer.weights.size(), layer.bias.size(),
      weights, layer.out);
}

void convolve(const Layer& layer, const float* input, Shape from, Shape to, Workspace& workspace,
              std::vector<float>& padded, std::vector<float>& output, bool parallel) {
  const Padded source = pad(layer, input, from, padded);
  const int pixels = to.height * to.width;
  const GemmKernels& kernels = gemm_kernels();
  const auto depth = static_cast<std::size_t>(layer.depth());
  if (pixels == 1) {  // a fully connected layer
    workspace.columns.resize(depth);
    gather(layer, source, to, 0, 1, 1, workspace.columns.data());
    output.assign(layer.bias.begin(), layer.bias.end());
    kernels.dots(layer.out, 1, layer.depth(), layer.weights.data(), layer.depth(),
                 workspace.columns.data(), 0, output.data(), 1);
    if (layer.relu)
      for (float& value : output) value = std::max(0.0F, value);
    return;
  }
  const auto add_bias = [&](const float* product, int at, int begin, int count) {
    for (int o = 0; o < layer.out; ++o) {
      const float bias = layer.bias[static_cast<std::size_t>(o)];
      const float* from_row = product + static_cast<std::ptrdiff_t>(o) * kPanel + at;
      float* to_row = output.data() + static_cast<std::ptrdiff_t>(o) * pixels + begin;
      if (layer.relu) {
        for (int i = 0; i < count; ++i) to_row[i] = std::max(0.0F, from_row[i] + bias);
      } else {
        for (int i = 0; i < count; ++i) to_row[i] = from_row[i] + bias;
      }
    }
  };
  // With stride 1, the pixels of a panel are counted along the padded rows and read in place.
  const bool in_place = layer.stride == 1;
  const int line = in_place ? source.width : to.width;
  const int counted = (to.height - 1) * line + to.width;
  const int panels = (counted + kPanel - 1) / kPanel;
  if (in_place) window_offsets(layer, source, workspace.offsets);
  const auto work = [&](int first, int last, std::vector<float>& columns,
                        std::vector<float>& product) {
    if (!in_place) columns.resize(depth * kPanel);
    product.resize(static_cast<std::size_t>(layer.out) * kPanel);
    for (int p = first; p < last; ++p) {
      const int begin = p * kPanel;
      const int count = std::min(kPanel, counted - begin);
      if (!in_place) {
        gather(layer, source, to, begin, count, kPanel, columns.data());
        kernels.panel(layer.out, layer.depth(), layer.weights.data(), layer.depth(), 1,
                      columns.data(), kPanel, product.data());
        add_bias(product.data(), 0, begin, count);
        continue;
      }
      kernels.panel_at(layer.out, layer.depth(), layer.weights.data(), source.data + begin,
                       workspace.offsets.data(), product.data());
      for (int at = 0; at < count;) {
        const int y = (begin + at) / line;
        const int x = (begin + at) % line;
        const int length = std::min(count - at, to.width - x);
        if (length > 0) add_bias(product.data(), at, y * to.width + x, length);
        at += length > 0 ? length : std::min(count - at, line - x);
      }
    }
  };
  if (!parallel || panels < 2 * kParallelPanels) {
    work(0, panels, workspace.columns, workspace.panel);
    return;
  }
  cv::parallel_for_(
      cv::Range(0, panels),
      [&](const cv::Range& range) {
        std::vector<float> columns;
        std::vector<float> product;
        work(range.start, range.end, columns, product);
      },
      static_cast<double>(panels) / kParallelPanels);
}

// The common case, two rows at a time.
void take_maximum_of_four(const float* input, Shape from, Shape to, float* output) {
  for (int c = 0; c < to.channels; ++c) {
    const float* plane = input + static_cast<std::ptrdiff_t>(c) * from.height * from.width;
    for (int y = 0; y < to.height; ++y) {
      const float* upper = plane + static_cast<std::ptrdiff_t>(2 * y) * from.width;
      const float* lower = upper + from.width;
      for (int x = 0; x < to.width; ++x) {
        const float left = upper[2 * x] > lower[2 * x] ? upper[2 * x] : lower[2 * x];
        const float right =
            upper[2 * x + 1] > lower[2 * x + 1] ? upper[2 * x + 1] : lower[2 * x + 1];
        output[x] = left > right ? left : right;
      }
      output += to.width;
    }
  }
}

void take_maximum(const Layer& layer, const float* input, Shape from, Shape to, float* output) {
  if (layer.kernel_y == 2 && layer.kernel_x == 2) {
    take_maximum_of_four(input, from, to, output);
    return;
  }
  for (int c = 0; c < to.channels; ++c) {
    const float* plane = input + static_cast<std::ptrdiff_t>(c) * from.height * from.width;
    for (int y = 0; y < to.height; ++y) {
      for (int x = 0; x < to.width; ++x) {
        const float* corner = plane + static_cast<std::ptrdiff_t>(y * layer.kernel_y) * from.width +
                              static_cast<std::ptrdiff_t>(x) * layer.kernel_x;
        float best = *corner;
        for (int v = 0; v < layer.kernel_y; ++v)
          for (int u = 0; u < layer.kernel_x; ++u)
            best = std::max(best, corner[v * from.width + u]);
        *output++ = best;
      }
    }
  }
}

}  // namespace

Shape Layer::output(const Shape& input) const {
  TARSIER_REQUIRE(input.channels == in, "a map of {} channels for a layer of {}", input.channels,
                  in);
  Shape result;
  result.channels = out;
  if (kind == Kind::kMaximum) {
    result.height = input.height / kernel_y;
    result.width = input.width / kernel_x;
  } else {
    const int reach_y = dilation * (kernel_y - 1) + 1;
    const int reach_x = dilation * (kernel_x - 1) + 1;
    result.height = (input.height + 2 * pad_y - reach_y) / stride + 1;
    result.width = (input.width + 2 * pad_x - reach_x) / stride + 1;
    if (input.height + 2 * pad_y < reach_y || input.width + 2 * pad_x < reach_x) result.height = 0;
  }
  TARSIER_REQUIRE(result.height > 0 && result.width > 0, "a map of {}x{} is too small here",
                  input.width, input.height);
  return result;
}

Layer convolution(int in, int out, int kernel_y, int kernel_x, bool relu) {
  Layer layer;
  layer.in = in;
  layer.out = out;
  layer.kernel_y = kernel_y;
  layer.kernel_x = kernel_x;
  layer.pad_y = kernel_y / 2;
  layer.pad_x = kernel_x / 2;
  layer.relu = relu;
  layer.weights.assign(static_cast<std::size_t>(out) * static_cast<std::size_t>(layer.depth()), 0);
  layer.bias.assign(static_cast<std::size_t>(out), 0);
  return layer;
}

Layer maximum(int channels, int kernel_y, int kernel_x) {
  Layer layer;
  layer.kind = Layer::Kind::kMaximum;
  layer.in = layer.out = channels;
  layer.kernel_y = kernel_y;
  layer.kernel_x = kernel_x;
  layer.pad_y = layer.pad_x = 0;
  layer.relu = false;
  return layer;
}

Shape Network::output(Shape input) const {
  for (const Layer& layer : layers) input = layer.output(input);
  return input;
}

std::size_t Network::parameters() const {
  std::size_t total = 0;
  for (const Layer& layer : layers) total += layer.weights.size() + layer.bias.size();
  return total;
}

double Network::cost(Shape input) const {
  double total = 0;
  for (const Layer& layer : layers) {
    input = layer.output(input);
    if (layer.kind == Layer::Kind::kConvolution)
      total += static_cast<double>(input.size()) * layer.depth();
  }
  return total;
}

void Network::check() const {
  TARSIER_REQUIRE(!layers.empty() && layers.size() <= 64, "{} layers", layers.size());
  for (std::size_t i = 0; i < layers.size(); ++i) {
    check_layer(layers[i]);
    TARSIER_REQUIRE(i == 0 || layers[i - 1].out == layers[i].in,
                    "layer {} gives {} channels, the next takes {}", i, layers[i - 1].out,
                    layers[i].in);
  }
}

void initialize(Network& network, Rng& rng) {
  for (Layer& layer : network.layers) {
    if (layer.kind != Layer::Kind::kConvolution) continue;
    double sigma = std::sqrt(2.0 / layer.depth());
    if (&layer == &network.layers.back()) sigma *= 0.1;
    for (float& weight : layer.weights) weight = static_cast<float>(rng.normal(0, sigma));
    std::fill(layer.bias.begin(), layer.bias.end(), 0.0F);
  }
}

const std::vector<float>& run(const Network& network, const float* input, Shape shape,
                              Workspace& workspace, bool parallel) {
  const std::size_t count = network.layers.size();
  workspace.maps.resize(count);
  workspace.padded.resize(count);
  workspace.shapes.assign(1, shape);
  for (std::size_t i = 0; i < count; ++i) {
    const Layer& layer = network.layers[i];
    const Shape from = workspace.shapes.back();
    const Shape to = layer.output(from);
    const float* source = i == 0 ? input : workspace.maps[i - 1].data();
    workspace.maps[i].resize(to.size());
    if (layer.kind == Layer::Kind::kMaximum)
      take_maximum(layer, source, from, to, workspace.maps[i].data());
    else
      convolve(layer, source, from, to, workspace, workspace.padded[i], workspace.maps[i],
               parallel);
    workspace.shapes.push_back(to);
  }
  return workspace.maps.back();
}

void run_layer(const Layer& layer, const float* input, Shape from, Workspace& workspace,
               std::vector<float>& output, bool parallel) {
  TARSIER_REQUIRE(layer.kind == Layer::Kind::kConvolution, "a maximum is not a convolution");
  const Shape to = layer.output(from);
  if (workspace.padded.empty()) workspace.padded.resize(1);
  output.resize(to.size());
  convolve(layer, input, from, to, workspace, workspace.padded.front(), output, parallel);
}

}  // namespace tarsier::linalg
