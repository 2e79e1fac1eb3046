// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/types.hpp>

#include <array>
#include <cmath>
#include <cstddef>

namespace tarsier::planar::image_targets {

// Root mean square distance of the corners, px; for tests.
inline double corner_rms(const std::array<cv::Point2d, 4>& a, const std::array<cv::Point2d, 4>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < 4; ++i) sum += (a[i] - b[i]).dot(a[i] - b[i]);
  return std::sqrt(sum / 4);
}

}  // namespace tarsier::planar::image_targets
