// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <string>

namespace tarsier {

// Writes `image` as tarsier-0001.png in `folder`, which is made if it is missing, or as the next
// number that no file has. Returns its path. Throws OutputError.
std::string save_numbered(const std::string& folder, const cv::Mat& image);

}  // namespace tarsier
