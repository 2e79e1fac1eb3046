// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"

#include <opencv2/core.hpp>

#include <algorithm>

namespace tarsier::sfm {

constexpr int kImageCells = 48;  // 8 x 6

// Index of the image cell of a pixel, row by row. A pixel outside belongs to the nearest cell.
inline int image_cell(const cv::Point2f& pixel, const geometry::Camera& camera) {
  const int x = std::clamp(static_cast<int>(static_cast<double>(pixel.x) * 8 / camera.width), 0, 7);
  const int y =
      std::clamp(static_cast<int>(static_cast<double>(pixel.y) * 6 / camera.height), 0, 5);
  return y * 8 + x;
}

}  // namespace tarsier::sfm
