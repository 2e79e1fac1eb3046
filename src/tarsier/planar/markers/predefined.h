// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/markers/dictionary.h"

#include <opencv2/core.hpp>

#include <string_view>
#include <vector>

// The one door to OpenCV's aruco module, whose interface changed at 4.7.
namespace tarsier::planar::markers {

struct PredefinedCodes {
  int cells = 0;
  std::vector<Code> codes;  // by id
};

// The codes of one of dictionary_names(); cells = 0 for any other name.
[[nodiscard]] PredefinedCodes predefined_codes(std::string_view name);

struct OpencvMarker {
  int id = 0;
  std::vector<cv::Point2f> corners;  // px, the marker's own top left first, clockwise
};

// What OpenCV's own detector finds (corners refined to sub-pixel), for comparison. `image` is 8-bit
// grey or BGR.
[[nodiscard]] std::vector<OpencvMarker> detect_with_opencv(const cv::Mat& image,
                                                           std::string_view name);

}  // namespace tarsier::planar::markers
