// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

#include <string>
#include <vector>

namespace tarsier::sfm {

// Writes an animated GIF that repeats forever, with one palette for all frames. The colours are
// exact where there are at most 255, otherwise the best 255 without dithering. `frames`: one or
// more, CV_8UC3, of one size of at most 65535 px per side. `fps`: 0.01..50; browsers do not show
// more. The file is written completely or not at all. Throws OutputError, std::invalid_argument.
void write_gif(const std::string& path, const std::vector<cv::Mat>& frames, double fps);

}  // namespace tarsier::sfm
