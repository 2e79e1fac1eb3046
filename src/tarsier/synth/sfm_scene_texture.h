// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

// Textures of the surfaces of sfm_scene.h: value noise with small shapes on it.
namespace tarsier::synth {

// floor() without a function call; for |x| < 2^22.
inline int floor_of(double x) {
  constexpr int kShift = 1 << 22;
  return static_cast<int>(x + kShift) - kShift;
}

inline int wrapped(int i, int n) {
  if (i >= 0 && i < n) return i;
  i %= n;
  return i < 0 ? i + n : i;
}

// A mipmapped colour texture in world units that repeats at its ends.
class Texture {
 public:
  Texture() = default;
  // `width` and `height` in units; `base`: source of all random numbers.
  Texture(double width, double height, double texels_per_unit, const Rng& base);

  // Colour at (u, v) units, filtered to details larger than `footprint` units.
  [[nodiscard]] cv::Vec3f at(double u, double v, double footprint) const {
    const auto top = static_cast<double>(levels_.size() - 1);
    const double level = std::clamp(std::log2(footprint * scale_), 0.0, top);
    const auto whole = static_cast<std::size_t>(level);
    const auto part = static_cast<float>(level - static_cast<double>(whole));
    const cv::Vec3f fine = bilinear(levels_[whole], u, v, whole);
    if (part == 0) return fine;
    return fine + part * (bilinear(levels_[whole + 1], u, v, whole + 1) - fine);
  }

 private:
  [[nodiscard]] cv::Vec3f bilinear(const cv::Mat& level, double u, double v,
                                   std::size_t halvings) const {
    const double scale = scale_ / static_cast<double>(1U << halvings);
    const double x = u * scale - 0.5;
    const double y = v * scale - 0.5;
    const int xi = floor_of(x);
    const int yi = floor_of(y);
    const auto fx = static_cast<float>(x - xi);
    const auto fy = static_cast<float>(y - yi);
    const int x0 = wrapped(xi, level.cols);
    const int x1 = wrapped(xi + 1, level.cols);
    const auto* above = level.ptr<cv::Vec3b>(wrapped(yi, level.rows));
    const auto* below = level.ptr<cv::Vec3b>(wrapped(yi + 1, level.rows));
    cv::Vec3f out;
    for (int c = 0; c < 3; ++c) {
      const auto a = static_cast<float>(above[x0][c]);
      const auto b = static_cast<float>(above[x1][c]);
      const auto d = static_cast<float>(below[x0][c]);
      const auto e = static_cast<float>(below[x1][c]);
      const float up = a + fx * (b - a);
      out[c] = up + fy * (d + fx * (e - d) - up);
    }
    return out;
  }

  double scale_ = 1;  // texels per unit
  std::vector<cv::Mat> levels_;
};

}  // namespace tarsier::synth
