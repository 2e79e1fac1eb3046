// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/markers/detector.h"
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

// What OpenCV's own detector finds (corners refined to sub-pixel), for comparison: id and corners.
// `image` is 8-bit grey or BGR. Throws std::invalid_argument for a family that OpenCV does not know.
[[nodiscard]] std::vector<Marker> detect_with_opencv(const cv::Mat& image, std::string_view name);

}  // namespace tarsier::planar::markers
