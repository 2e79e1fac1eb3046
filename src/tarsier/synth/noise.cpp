// SPDX-License-Identifier: MIT
#include "tarsier/synth/noise.h"

#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <array>
#include <cmath>

namespace tarsier::synth {
namespace {

constexpr std::size_t kLevels = 4096;

// Quantiles of the normal distribution at the centres of 4096 equal shares. A table look-up per
// sample is many times faster than drawing, and as good for 8-bit images.
double normal_quantile(double p) {
  double low = -8;
  double high = 8;
  for (int i = 0; i < 40; ++i) {
    const double middle = (low + high) / 2;
    (0.5 * std::erfc(-middle / std::sqrt(2.0)) < p ? low : high) = middle;
  }
  return (low + high) / 2;
}

const std::array<float, kLevels>& normal_table() {
  static const std::array<float, kLevels> table = [] {
    std::array<float, kLevels> values{};
    for (std::size_t i = 0; i < kLevels; ++i) {
      values[i] = static_cast<float>(normal_quantile((static_cast<double>(i) + 0.5) / kLevels));
    }
    return values;
  }();
  return table;
}

}  // namespace

void add_noise(cv::Mat& image, double sigma, std::uint64_t seed) {
  TARSIER_REQUIRE(image.depth() == CV_8U && image.dims == 2, "type {}", image.type());
  TARSIER_REQUIRE(sigma >= 0 && sigma <= 64, "sigma {}", sigma);
  if (sigma == 0 || image.empty()) return;
  // In 1/256 grey levels, plus half a level for rounding.
  std::array<std::int32_t, kLevels> steps{};
  for (std::size_t i = 0; i < kLevels; ++i) {
    steps[i] = static_cast<std::int32_t>(
                   std::lround(256 * sigma * static_cast<double>(normal_table()[i]))) +
               128;
  }
  const Rng base(seed);
  const int width = image.cols * image.channels();
  cv::parallel_for_(cv::Range(0, image.rows), [&](const cv::Range& rows) {
    for (int y = rows.start; y < rows.end; ++y) {
      Rng rng = base.fork(static_cast<std::uint64_t>(y));
      auto* row = image.ptr<std::uint8_t>(y);
      std::uint64_t bits = 0;
      int left = 0;
      for (int x = 0; x < width; ++x) {
        if (left == 0) {
          bits = rng();
          left = 5;
        }
        const std::int32_t value = (row[x] << 8) + steps[bits & (kLevels - 1)];
        row[x] = static_cast<std::uint8_t>(std::clamp(value >> 8, 0, 255));
        bits >>= 12U;
        --left;
      }
    }
  });
}

}  // namespace tarsier::synth
