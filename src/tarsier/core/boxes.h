// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/types.hpp>

#include <algorithm>
#include <concepts>

// Overlap of axis-aligned boxes, in 0..1. It is 0 where the boxes do not intersect, are empty or
// are not finite. Float boxes are compared in float; integer boxes convert to cv::Rect2d.
namespace tarsier {

// Intersection over union: the area of the intersection divided by the area of the union (the
// Jaccard index).
template <std::floating_point T>
[[nodiscard]] T iou(const cv::Rect_<T>& a, const cv::Rect_<T>& b) {
  const T common = (a & b).area();
  const T share = common / (a.area() + b.area() - common);
  return share > 0 ? share : 0;  // also for 0 / 0
}
[[nodiscard]] inline double iou(const cv::Rect2d& a, const cv::Rect2d& b) {
  return iou<double>(a, b);
}

// The area of the intersection divided by the area of the smaller box: 1 where one box contains the
// other.
template <std::floating_point T>
[[nodiscard]] T overlap_of_smaller(const cv::Rect_<T>& a, const cv::Rect_<T>& b) {
  const T common = (a & b).area();
  const T share = common / std::min(a.area(), b.area());
  return share > 0 ? share : 0;
}
[[nodiscard]] inline double overlap_of_smaller(const cv::Rect2d& a, const cv::Rect2d& b) {
  return overlap_of_smaller<double>(a, b);
}

}  // namespace tarsier
