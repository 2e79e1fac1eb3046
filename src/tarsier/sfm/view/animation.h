// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

#include <string>
#include <vector>

namespace tarsier::sfm {

// Writes an animated GIF that repeats for ever, with one palette for all frames: their very
// colours where they have 255 or fewer, the best 255 otherwise, without dithering. `frames`: one
// or more, CV_8UC3, of one size of at most 65535 px a side. `fps`: 0.01..50, more is not shown by
// browsers. The file is written whole or not at all. Throws OutputError, std::invalid_argument.
void write_gif(const std::string& path, const std::vector<cv::Mat>& frames, double fps);

}  // namespace tarsier::sfm
