// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <string>
#include <string_view>

namespace tarsier {

// One line: "640x480 CV_8UC3, min (0 3 1), max (255 250 255)": width x height, type, range per
// channel. NaN are counted, not compared: "2 NaN". "empty" for an empty matrix. The matrix has two
// dimensions and any depth.
[[nodiscard]] std::string mat_info(const cv::Mat& mat, std::string_view name = "");

// The values row by row, channels in brackets; at most `limit` rows and columns, then "...".
[[nodiscard]] std::string mat_print(const cv::Mat& mat, std::string_view name = "", int limit = 8);

}  // namespace tarsier
