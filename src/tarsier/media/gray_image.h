// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

namespace tarsier {

// Returns `image` itself if it is grey (CV_8UC1), else converts it from BGR (CV_8UC3). Throws
// std::invalid_argument for an empty image or another type.
[[nodiscard]] cv::Mat gray_of(const cv::Mat& image);

}  // namespace tarsier
