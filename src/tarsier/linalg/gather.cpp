// SPDX-License-Identifier: MIT
#include "tarsier/linalg/gather.h"

#include "tarsier/linalg/gemm.h"

#include <algorithm>
#include <cstring>

namespace tarsier::linalg {
namespace {

// Calls visit(column offset, padded row, padded column, length) for the runs of output pixels begin
// .. begin + count that lie in one output row.
template <typename Visit>
void for_runs(const Layer& layer, Shape to, int begin, int count, const Visit& visit) {
  for (int done = 0; done < count;) {
    const int y = (begin + done) / to.width;
    const int x = (begin + done) % to.width;
    const int length = std::min(count - done, to.width - x);
    visit(done, y * layer.stride, x * layer.stride, length);
    done += length;
  }
}

}  // namespace

Padded pad(const Layer& layer, const float* input, Shape from, std::vector<float>& buffer) {
  Padded result;
  result.height = from.height + 2 * layer.pad_y;
  result.width = from.width + 2 * layer.pad_x;
  const auto width = static_cast<std::size_t>(result.width);
  const auto inner = static_cast<std::size_t>(from.width);
  const auto side = static_cast<std::size_t>(layer.pad_x);
  const std::size_t rim = static_cast<std::size_t>(layer.pad_y) * width;
  buffer.resize(static_cast<std::size_t>(from.channels) * static_cast<std::size_t>(result.height) *
                    width +
                kPanel);
  float* to = buffer.data();
  const auto clear = [&](std::size_t count) { to = std::fill_n(to, count, 0.0F); };
  for (int c = 0; c < from.channels; ++c) {
    clear(rim);
    for (int y = 0; y < from.height; ++y) {
      clear(side);
      std::memcpy(to, input, inner * sizeof(float));
      to += inner;
      input += inner;
      clear(side);
    }
    clear(rim);
  }
  clear(kPanel);
  result.data = buffer.data();
  return result;
}

void window_offsets(const Layer& layer, const Padded& source,
                    std::vector<std::ptrdiff_t>& offsets) {
  offsets.clear();
  for (int c = 0; c < layer.in; ++c) {
    for (int v = 0; v < layer.kernel_y; ++v) {
      for (int u = 0; u < layer.kernel_x; ++u) {
        offsets.push_back((static_cast<std::ptrdiff_t>(c) * source.height + v * layer.dilation) *
                              source.width +
                          u * layer.dilation);
      }
    }
  }
}

void gather(const Layer& layer, const Padded& source, Shape to, int begin, int count, int stride,
            float* columns) {
  for (int c = 0; c < layer.in; ++c) {
    for (int v = 0; v < layer.kernel_y; ++v) {
      for (int u = 0; u < layer.kernel_x; ++u) {
        const float* plane =
            source.data +
            (static_cast<std::ptrdiff_t>(c) * source.height + v * layer.dilation) * source.width +
            u * layer.dilation;
        for_runs(layer, to, begin, count, [&](int at, int y, int x, int length) {
          const float* row = plane + static_cast<std::ptrdiff_t>(y) * source.width + x;
          if (layer.stride == 1) {
            std::memcpy(columns + at, row, static_cast<std::size_t>(length) * sizeof(float));
          } else {
            for (int i = 0; i < length; ++i) columns[at + i] = row[i * layer.stride];
          }
        });
        std::fill(columns + count, columns + stride, 0.0F);
        columns += stride;
      }
    }
  }
}

void scatter(const Layer& layer, const float* columns, int stride, Shape to, int begin, int count,
             float* padded, int padded_height, int padded_width) {
  for (int c = 0; c < layer.in; ++c) {
    for (int v = 0; v < layer.kernel_y; ++v) {
      for (int u = 0; u < layer.kernel_x; ++u) {
        float* plane =
            padded +
            (static_cast<std::ptrdiff_t>(c) * padded_height + v * layer.dilation) * padded_width +
            u * layer.dilation;
        for_runs(layer, to, begin, count, [&](int at, int y, int x, int length) {
          float* row = plane + static_cast<std::ptrdiff_t>(y) * padded_width + x;
          for (int i = 0; i < length; ++i) row[i * layer.stride] += columns[at + i];
        });
        columns += stride;
      }
    }
  }
}

}  // namespace tarsier::linalg
