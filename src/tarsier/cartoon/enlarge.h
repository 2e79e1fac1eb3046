// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/cartoon/plane.h"

#include <opencv2/core/mat.hpp>

#include <array>
#include <vector>

namespace tarsier::cartoon {

// The image of twice the size by bilinear interpolation, with lines drawn on it in the same pass:
// the bytes of cv::resize with INTER_LINEAR, then black where `mask` is 0.
class Enlarger {
 public:
  // `large` (CV_8UC3, made by the caller) from `small` (CV_8UC3). Where `large` is not exactly
  // twice `small`, cv::resize does it. `mask` (0 or 255, the size of `large`) may be null.
  void enlarge(const cv::Mat& small, const Plane* mask, cv::Mat& large);

 private:
  // Three rows of the small image in planes, in turn; one for each band of rows.
  std::vector<std::array<Plane, 3>> scratch_;
};

}  // namespace tarsier::cartoon
