// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/markers/detector.h"
#include "tarsier/planar/markers/dictionary.h"

#include <opencv2/core.hpp>

#include <string_view>
#include <vector>

// The only code that uses OpenCV's aruco module, whose interface changed in version 4.7.
namespace tarsier::planar::markers {

struct PredefinedCodes {
  int cells = 0;
  std::vector<Code> codes;  // in the order of ids
};

// The codes of one of dictionary_names(); cells = 0 for another name.
[[nodiscard]] PredefinedCodes predefined_codes(std::string_view name);

// The markers of OpenCV's own detector (corners refined to sub-pixel), for comparison: id and
// corners. `image` is 8-bit grey or BGR. Throws std::invalid_argument for a family that OpenCV does
// not have.
[[nodiscard]] std::vector<Marker> detect_with_opencv(const cv::Mat& image, std::string_view name);

}  // namespace tarsier::planar::markers
