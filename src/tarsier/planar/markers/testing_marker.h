// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/planar/markers/decode.h"
#include "tarsier/planar/markers/dictionary.h"

#include <Eigen/LU>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

// Draws markers with exactly known corners, for tests.
namespace tarsier::planar::markers {

struct DrawnMarker {
  int id = 0;
  Quad corners;
};

// Draws a marker with a white margin of one cell: the mean of 8 x 8 samples in each pixel.
inline void draw_marker(cv::Mat& gray, const Dictionary& family, const DrawnMarker& marker,
                        double black = 30, double white = 220) {
  constexpr int kSamples = 8;
  const int n = family.cells();
  const Eigen::Matrix3d cells_from_image = image_from_cells(marker.corners, n).inverse().eval();
  const Code code = family.code(marker.id);
  for (int y = 0; y < gray.rows; ++y) {
    for (int x = 0; x < gray.cols; ++x) {
      double sum = 0;
      int inside = 0;
      for (int i = 0; i < kSamples * kSamples; ++i) {
        const double dx = (i % kSamples + 0.5) / kSamples - 0.5;
        const double dy =
            static_cast<int>(i / kSamples + 0.5) / double{kSamples} + 0.5 / kSamples - 0.5;
        const Eigen::Vector3d p = cells_from_image * Eigen::Vector3d(x + dx, y + dy, 1);
        const double u = p.x() / p.z();
        const double v = p.y() / p.z();
        if (!(u > -1 && v > -1 && u < n + 3 && v < n + 3)) break;
        ++inside;
        const int column = static_cast<int>(std::floor(u)) - 1;
        const int row = static_cast<int>(std::floor(v)) - 1;
        bool is_white = u < 0 || v < 0 || u > n + 2 || v > n + 2;
        if (column >= 0 && row >= 0 && column < n && row < n)
          is_white = ((code >> static_cast<unsigned>(n * n - 1 - row * n - column)) & 1U) != 0;
        sum += is_white ? white : black;
      }
      if (inside == kSamples * kSamples)
        gray.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(sum / inside);
    }
  }
}

// A square about (x, y), rotated by `degrees`; its lower side is shorter by the fraction `tilt`.
inline Quad square(double x, double y, double side, double degrees, double tilt = 0) {
  const double angle = degrees * CV_PI / 180;
  const Eigen::Vector2d right(std::cos(angle), std::sin(angle));
  const Eigen::Vector2d down(-right.y(), right.x());
  const Eigen::Vector2d middle(x, y);
  const double lower = 1 - tilt;
  return {middle - side / 2 * right - side / 2 * down, middle + side / 2 * right - side / 2 * down,
          middle + side / 2 * lower * (right + down), middle + side / 2 * lower * (down - right)};
}

inline void add_noise(cv::Mat& gray, double deviation, std::uint64_t seed) {
  Rng rng(seed);
  for (int y = 0; y < gray.rows; ++y)
    for (int x = 0; x < gray.cols; ++x)
      gray.at<std::uint8_t>(y, x) =
          cv::saturate_cast<std::uint8_t>(gray.at<std::uint8_t>(y, x) + deviation * rng.normal());
}

inline double rmse(const Quad& a, const Quad& b) {
  double sum = 0;
  for (std::size_t k = 0; k < 4; ++k) sum += (a[k] - b[k]).squaredNorm();
  return std::sqrt(sum / 4);
}

}  // namespace tarsier::planar::markers
