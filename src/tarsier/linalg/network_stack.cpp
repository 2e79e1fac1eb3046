// SPDX-License-Identifier: MIT
#include "tarsier/linalg/network_stack.h"

#include "tarsier/core/require.h"
#include "tarsier/linalg/gemm.h"

#include <algorithm>
#include <cstring>

namespace tarsier::linalg {
namespace {

// The memory layout of a stack. There are margin_y rows of zeros before the first map, between two
// maps and after the last one. Each row ends in margin_x zeros, which also are the left padding of
// the next row.
struct Layout {
  Shape shape;
  int count = 0;
  int margin_y = 0;
  int margin_x = 0;

  [[nodiscard]] std::ptrdiff_t row() const { return shape.width + margin_x; }
  [[nodiscard]] std::ptrdiff_t map() const { return (shape.height + margin_y) * row(); }
  [[nodiscard]] std::ptrdiff_t first() const { return margin_x + margin_y * row(); }
  [[nodiscard]] std::ptrdiff_t plane() const { return first() + count * map(); }
  [[nodiscard]] std::size_t size() const {
    return static_cast<std::size_t>(plane()) * static_cast<std::size_t>(shape.channels);
  }
};

// A buffer never shrinks: growing it again would fill it with zeros unnecessarily.
float* reserve(std::vector<float>& buffer, std::size_t size) {
  if (buffer.size() < size) buffer.resize(size);
  return buffer.data();
}

// Kernels read whole panels; the last one may extend beyond the stack.
float* reserve(std::vector<float>& buffer, const Layout& layout) {
  float* data = reserve(buffer, layout.size() + kPanel);
  std::fill_n(data + layout.size(), kPanel, 0.0F);
  return data;
}

void clear_margins(const Layout& layout, float* data) {
  if (layout.margin_x == 0 && layout.margin_y == 0) return;
  const std::ptrdiff_t row = layout.row();
  for (int c = 0; c < layout.shape.channels; ++c) {
    float* plane = data + c * layout.plane();
    std::fill_n(plane, layout.first(), 0.0F);
    for (int i = 0; i < layout.count; ++i) {
      float* map = plane + layout.first() + i * layout.map();
      for (int y = 0; y < layout.shape.height; ++y) {
        std::fill_n(map + y * row + layout.shape.width, layout.margin_x, 0.0F);
      }
      std::fill_n(map + layout.shape.height * row, layout.margin_y * row, 0.0F);
    }
  }
}

// The layer's output gets the padding that the next convolution needs.
Layout layout_before(const Network& network, std::size_t next, Shape shape, int count) {
  Layout layout{shape, count, 0, 0};
  if (next < network.layers.size() && network.layers[next].kind == Layer::Kind::kConvolution) {
    layout.margin_y = network.layers[next].pad_y;
    layout.margin_x = network.layers[next].pad_x;
  }
  return layout;
}

void take_maximum(const Layer& layer, const Layout& from, const float* input, const Layout& to,
                  float* output) {
  for (int c = 0; c < to.shape.channels; ++c) {
    for (int i = 0; i < to.count; ++i) {
      for (int y = 0; y < to.shape.height; ++y) {
        const float* upper = input + c * from.plane() + from.first() + i * from.map() +
                             static_cast<std::ptrdiff_t>(y) * layer.kernel_y * from.row();
        float* result = output + c * to.plane() + to.first() + i * to.map() + y * to.row();
        if (layer.kernel_y == 2 && layer.kernel_x == 2) {
          const float* lower = upper + from.row();
          for (int x = 0; x < to.shape.width; ++x) {
            const float left = upper[2 * x] > lower[2 * x] ? upper[2 * x] : lower[2 * x];
            const float right =
                upper[2 * x + 1] > lower[2 * x + 1] ? upper[2 * x + 1] : lower[2 * x + 1];
            result[x] = left > right ? left : right;
          }
          continue;
        }
        for (int x = 0; x < to.shape.width; ++x) {
          const float* corner = upper + static_cast<std::ptrdiff_t>(x) * layer.kernel_x;
          float best = *corner;
          for (int v = 0; v < layer.kernel_y; ++v)
            for (int u = 0; u < layer.kernel_x; ++u)
              best = std::max(best, corner[v * from.row() + u]);
          result[x] = best;
        }
      }
    }
  }
}

// The input offset of each weight of an output channel, relative to the output pixel.
void find_offsets(const Layer& layer, const Layout& from, std::vector<std::ptrdiff_t>& offsets) {
  offsets.clear();
  for (int c = 0; c < layer.in; ++c) {
    for (int v = 0; v < layer.kernel_y; ++v) {
      for (int u = 0; u < layer.kernel_x; ++u) {
        offsets.push_back(c * from.plane() + (v * layer.dilation - layer.pad_y) * from.row() +
                          u * layer.dilation - layer.pad_x);
      }
    }
  }
}

// A fully connected layer: one output pixel per map.
void connect(const Layer& layer, const Layout& from, const float* input, const Layout& to,
             float* output, StackWorkspace& workspace) {
  const auto depth = static_cast<std::size_t>(layer.depth());
  float* columns = reserve(workspace.columns, depth * static_cast<std::size_t>(to.count));
  float* column = columns;
  for (int i = 0; i < to.count; ++i) {
    const float* map = input + from.first() + i * from.map();
    for (const std::ptrdiff_t offset : workspace.offsets) *column++ = map[offset];
  }
  float* sums = reserve(workspace.product,
                        static_cast<std::size_t>(layer.out) * static_cast<std::size_t>(to.count));
  for (int o = 0; o < layer.out; ++o) {
    std::fill_n(sums + static_cast<std::ptrdiff_t>(o) * to.count, to.count,
                layer.bias[static_cast<std::size_t>(o)]);
  }
  gemm_kernels().dots(layer.out, to.count, layer.depth(), layer.weights.data(), layer.depth(),
                      columns, layer.depth(), sums, to.count);
  for (int o = 0; o < layer.out; ++o) {
    for (int i = 0; i < to.count; ++i) {
      const float sum = *sums++;
      output[o * to.plane() + to.first() + i * to.map()] = layer.relu ? std::max(0.0F, sum) : sum;
    }
  }
}

void convolve(const Layer& layer, const Layout& from, const float* input, const Layout& to,
              float* output, StackWorkspace& workspace) {
  find_offsets(layer, from, workspace.offsets);
  if (to.shape.height * to.shape.width == 1) {
    connect(layer, from, input, to, output, workspace);
    return;
  }
  float* product = reserve(workspace.product, static_cast<std::size_t>(layer.out) * kPanel);
  const std::ptrdiff_t counted =
      (to.count - 1) * from.map() + (to.shape.height - 1) * from.row() + to.shape.width;
  for (std::ptrdiff_t begin = 0; begin < counted; begin += kPanel) {
    gemm_kernels().panel_at(layer.out, layer.depth(), layer.weights.data(),
                            input + from.first() + begin, workspace.offsets.data(), product);
    const std::ptrdiff_t end = std::min<std::ptrdiff_t>(begin + kPanel, counted);
    // The parts of the panel that are output pixels, row by row.
    for (std::ptrdiff_t at = begin; at < end;) {
      const std::ptrdiff_t i = at / from.map();
      const std::ptrdiff_t y = at % from.map() / from.row();
      const std::ptrdiff_t x = at % from.map() % from.row();
      const std::ptrdiff_t rest = std::min(end - at, from.row() - x);
      const std::ptrdiff_t length = std::min(rest, to.shape.width - x);
      if (y < to.shape.height && length > 0) {
        float* result = output + to.first() + i * to.map() + y * to.row() + x;
        for (int o = 0; o < layer.out; ++o) {
          const float bias = layer.bias[static_cast<std::size_t>(o)];
          const float* sums = product + static_cast<std::ptrdiff_t>(o) * kPanel + (at - begin);
          float* row = result + o * to.plane();
          if (layer.relu) {
            for (std::ptrdiff_t k = 0; k < length; ++k) row[k] = std::max(0.0F, sums[k] + bias);
          } else {
            for (std::ptrdiff_t k = 0; k < length; ++k) row[k] = sums[k] + bias;
          }
        }
      }
      at += rest;
    }
  }
}

}  // namespace

bool can_stack(const Network& network) {
  return std::all_of(network.layers.begin(), network.layers.end(), [](const Layer& layer) {
    return layer.kind == Layer::Kind::kMaximum || layer.stride == 1;
  });
}

const std::vector<float>& run_stack(const Network& network, const float* input, Shape shape,
                                    int count, StackWorkspace& workspace) {
  TARSIER_REQUIRE(count >= 1, "a stack of {} maps", count);
  TARSIER_REQUIRE(can_stack(network), "a convolution has another stride than 1");
  Layout from = layout_before(network, 0, shape, count);
  float* source = reserve(workspace.maps[0], from);
  clear_margins(from, source);
  for (int c = 0; c < shape.channels; ++c) {
    for (int i = 0; i < count; ++i) {
      for (int y = 0; y < shape.height; ++y) {
        std::memcpy(source + c * from.plane() + from.first() + i * from.map() + y * from.row(),
                    input, static_cast<std::size_t>(shape.width) * sizeof(float));
        input += shape.width;
      }
    }
  }
  for (std::size_t i = 0; i < network.layers.size(); ++i) {
    const Layer& layer = network.layers[i];
    const bool last = i + 1 == network.layers.size();
    const Layout to = layout_before(network, i + 1, layer.output(from.shape), count);
    if (last) workspace.result.resize(to.size());
    float* target = last ? workspace.result.data() : reserve(workspace.maps[(i + 1) % 2], to);
    clear_margins(to, target);
    if (layer.kind == Layer::Kind::kMaximum) {
      take_maximum(layer, from, source, to, target);
    } else {
      convolve(layer, from, source, to, target, workspace);
    }
    from = to;
    source = target;
  }
  return workspace.result;
}

}  // namespace tarsier::linalg
