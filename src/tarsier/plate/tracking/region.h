// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/types.hpp>

#include <string_view>
#include <vector>

namespace tarsier::plate {

// A region of the image. Coordinates are fractions of its width and height, or pixels.
struct Region {
  // A polygon of at least three corners; empty means the whole image.
  std::vector<cv::Point2d> corners;
  bool relative = false;

  // Even-odd rule. The result is undefined for points on an edge.
  [[nodiscard]] bool contains(cv::Point2d point, cv::Size image) const;
  // Whether the centre of the box, px, is inside.
  [[nodiscard]] bool contains_center(const cv::Rect& box, cv::Size image) const;
  // Corners in px, for drawing.
  [[nodiscard]] std::vector<cv::Point> outline(cv::Size image) const;
};

// Parses "x,y,w,h", or three to 32 corners "x,y x,y x,y" (or separated by ';'). The coordinates are
// relative if no number is above 1. Throws UsageError for another format, negative numbers or an
// empty area.
[[nodiscard]] Region parse_region(std::string_view text);

}  // namespace tarsier::plate
