// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/cartoon/plane.h"

#include <opencv2/core/mat.hpp>

#include <array>
#include <vector>

namespace tarsier::cartoon {

// Doubles the size of an image by bilinear interpolation and draws lines on it in the same pass.
// The result is identical to cv::resize with INTER_LINEAR, then black where `mask` is 0.
class Enlarger {
 public:
  // Writes `large` (CV_8UC3, allocated by the caller) from `small` (CV_8UC3). If `large` is not
  // exactly twice as large as `small`, cv::resize is used. `mask` (0 or 255, the size of `large`)
  // may be null.
  void enlarge(const cv::Mat& small, const Plane* mask, cv::Mat& large);

 private:
  // Three rows of the small image in planes, used in rotation; one set for each band of rows.
  std::vector<std::array<Plane, 3>> scratch_;
};

}  // namespace tarsier::cartoon
