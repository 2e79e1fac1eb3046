// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/lbp.h"

#include "tarsier/core/image.h"
#include "tarsier/core/require.h"

#include <cmath>
#include <cstdint>
#include <limits>

namespace tarsier::face::recognition {

constexpr float kEpsilon = std::numeric_limits<float>::epsilon();

int lbp_length(const LbpOptions& options) {
  options.check();
  return options.grid * options.grid * (1 << options.neighbours);
}

std::vector<float> lbp_histograms(const cv::Mat& gray, const LbpOptions& options) {
  require_gray(gray);
  options.check();
  const int r = options.radius;
  const int width = gray.cols - 2 * r;
  const int height = gray.rows - 2 * r;
  TARSIER_REQUIRE(width >= options.grid && height >= options.grid,
                  "a face of {}x{} is too small for local binary patterns", gray.cols, gray.rows);
  std::vector<std::uint32_t> patterns(static_cast<std::size_t>(width) *
                                      static_cast<std::size_t>(height));
  for (int i = 0; i < options.neighbours; ++i) {
    const double angle = 2 * CV_PI * i / options.neighbours;
    const double x = r * std::cos(angle);
    const double y = -r * std::sin(angle);
    const int left = static_cast<int>(std::floor(x));
    const int top = static_cast<int>(std::floor(y));
    const auto tx = static_cast<float>(x - left);
    const auto ty = static_cast<float>(y - top);
    const float w00 = (1 - tx) * (1 - ty);
    const float w01 = tx * (1 - ty);
    const float w10 = (1 - tx) * ty;
    const float w11 = tx * ty;
    // On an axis the second pixel has zero weight (except for rounding) and may be outside the
    // image.
    const int dx = std::min(left + 1, r) - left;
    const int dy = std::min(top + 1, r) - top;
    std::size_t at = 0;
    for (int row = 0; row < height; ++row) {
      const auto* centre = gray.ptr<std::uint8_t>(row + r) + r;
      const auto* upper = gray.ptr<std::uint8_t>(row + r + top) + r + left;
      const auto* lower = gray.ptr<std::uint8_t>(row + r + top + dy) + r + left;
      for (int column = 0; column < width; ++column, ++at) {
        const float value = w00 * upper[column] + w01 * upper[column + dx] + w10 * lower[column] +
                            w11 * lower[column + dx];
        const auto middle = static_cast<float>(centre[column]);
        if (value > middle || std::abs(value - middle) < kEpsilon) patterns[at] |= 1U << i;
      }
    }
  }
  const auto bins = static_cast<std::size_t>(1) << options.neighbours;
  const int cell_width = width / options.grid;
  const int cell_height = height / options.grid;
  const float share = 1.0F / static_cast<float>(cell_width * cell_height);
  std::vector<float> out(static_cast<std::size_t>(lbp_length(options)), 0.0F);
  for (int row = 0; row < cell_height * options.grid; ++row) {
    for (int column = 0; column < cell_width * options.grid; ++column) {
      const auto cell =
          static_cast<std::size_t>(row / cell_height * options.grid + column / cell_width);
      const auto pattern =
          patterns[static_cast<std::size_t>(row) * static_cast<std::size_t>(width) +
                   static_cast<std::size_t>(column)];
      out[cell * bins + pattern] += share;
    }
  }
  return out;
}

double chi_square(std::span<const float> a, std::span<const float> b) {
  TARSIER_REQUIRE(a.size() == b.size(), "{} and {} numbers", a.size(), b.size());
  double total = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    const float sum = a[i] + b[i];
    if (sum <= 0) continue;
    const float difference = a[i] - b[i];
    total += difference * difference / sum;
  }
  return 2 * total;
}

}  // namespace tarsier::face::recognition
