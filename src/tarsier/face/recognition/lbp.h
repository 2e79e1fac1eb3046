// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core/mat.hpp>

#include <span>
#include <vector>

// Local binary patterns (Ahonen, Hadid and Pietikainen, "Face description with local binary
// patterns", PAMI 2006).
namespace tarsier::face::recognition {

struct LbpOptions {
  int radius = 1;      // of the circle, px
  int neighbours = 8;  // points on it
  int grid = 8;        // cells across and down

  [[nodiscard]] OptionFields fields() {
    return {{"radius", radius, range(1, 20)},
            {"neighbours", neighbours, range(4, 10)},
            {"grid", grid, range(1, 32)}};
  }
  void check() const { check_fields(*this); }
};

// grid * grid * 2^neighbours.
[[nodiscard]] int lbp_length(const LbpOptions& options);

// Bit i of a pixel's pattern is set if the face at the offset radius * (cos, -sin)(2 pi i /
// neighbours) (bilinear) is not darker than the pixel. The result holds one histogram per cell, row
// by row, each summing to 1. Cells have equal integer sizes from the top left; remaining pixels are
// ignored. `gray`: CV_8UC1, larger than 2 radius + grid; otherwise throws std::invalid_argument.
[[nodiscard]] std::vector<float> lbp_histograms(const cv::Mat& gray, const LbpOptions& options);

// 2 sum (a - b)^2 / (a + b), for lists of equal length.
[[nodiscard]] double chi_square(std::span<const float> a, std::span<const float> b);

}  // namespace tarsier::face::recognition
