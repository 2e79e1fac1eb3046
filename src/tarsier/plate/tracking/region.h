// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/types.hpp>

#include <string_view>
#include <vector>

namespace tarsier::plate {

// Part of the image. Coordinates are shares of its width and height, or pixels.
struct Region {
  std::vector<cv::Point2d> corners;  // a polygon, at least three; empty: the whole image
  bool relative = false;

  // By the even-odd rule; points on an edge may be either.
  [[nodiscard]] bool contains(cv::Point2d point, cv::Size image) const;
  // Corners in px, for drawing.
  [[nodiscard]] std::vector<cv::Point> outline(cv::Size image) const;
};

// "x,y,w,h", or three to 32 corners "x,y x,y x,y" (or with ';' between). Relative where no number
// is above 1. Throws UsageError: not such a text, negative numbers, no area.
[[nodiscard]] Region parse_region(std::string_view text);

}  // namespace tarsier::plate
