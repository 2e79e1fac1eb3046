// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <string>

namespace tarsier {

// Writes `image` as tarsier-0001.png, or with the next unused number, in `folder`, which is created
// if missing. Returns the path. Throws OutputError.
std::string save_numbered(const std::string& folder, const cv::Mat& image);

}  // namespace tarsier
