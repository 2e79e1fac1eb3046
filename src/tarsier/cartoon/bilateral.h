// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/cartoon/kernels.h"
#include "tarsier/cartoon/options.h"
#include "tarsier/cartoon/plane.h"

#include <opencv2/core/mat.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace tarsier::cartoon {

// Repeated bilateral filtering of a colour image, with 7-bit weights and 16-bit sums.
//
// The filter is that of cv::bilateralFilter: weight exp(-|v - c|_1^2 / 2 sigma_color^2 - r^2 / 2
// sigma_space^2) in a disc of the given diameter; the border is mirrored without repeating the
// border pixel. Weights are rounded to 1/127 (or slightly coarser if the sums require it), so a
// colour distance of 32 or more has weight 0 at sigma_color <= 9.6.
class BilateralPainter {
 public:
  // False if the weights cannot be represented (sigma_color too large for 32 distances).
  [[nodiscard]] static bool supports(const PaintOptions& options);

  // Filters `image` (CV_8UC3) in place, `passes` times.
  void paint(cv::Mat& image, const PaintOptions& options, int passes);
  // The same with the kernels of one instruction set (tests, benchmarks).
  void paint_with(const Kernels& kernels, cv::Mat& image, const PaintOptions& options, int passes);

 private:
  using Image = std::array<Plane, 3>;

  struct Prepared {
    int diameter = 0;
    double sigma_color = 0;
    double sigma_space = 0;
    std::ptrdiff_t stride = 0;
    bool operator==(const Prepared&) const = default;
  };

  void prepare(const PaintOptions& options, std::ptrdiff_t stride);
  void prepare_quads();
  void filter_row(const Kernels& kernels, const Image& from, int y_from, Image& to, int y_to) const;
  void filter(const Kernels& kernels, const Image& from, Image& to);
  void filter_twice(const Kernels& kernels, const Image& from, Image& to);

  Prepared prepared_;  // parameters of the tables below
  Image front_;
  Image back_;
  std::vector<Image> between_;  // intermediate image of filter_twice, one per band
  std::vector<std::uint8_t> weights_;
  std::vector<int> ring_end_;
  std::vector<std::ptrdiff_t> offsets_;
  AlignedBytes quads_;
  BilateralTaps taps_{};
  int radius_ = 0;
};

}  // namespace tarsier::cartoon
