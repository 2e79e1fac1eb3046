// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/types.hpp>

#include <algorithm>

// Overlap of axis-aligned boxes, in 0..1; 0 where they do not meet or are empty. Whole-pixel boxes
// convert to cv::Rect2d.
namespace tarsier {

// Area of the intersection over that of the union (the Jaccard index).
[[nodiscard]] inline double intersection_over_union(const cv::Rect2d& a, const cv::Rect2d& b) {
  const double common = (a & b).area();
  return common > 0 ? common / (a.area() + b.area() - common) : 0;
}

// Area of the intersection over that of the smaller box: 1 where one box lies within the other.
[[nodiscard]] inline double overlap_of_smaller(const cv::Rect2d& a, const cv::Rect2d& b) {
  const double common = (a & b).area();
  return common > 0 ? common / std::min(a.area(), b.area()) : 0;
}

}  // namespace tarsier
