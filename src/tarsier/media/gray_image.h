// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

namespace tarsier {

// `image` itself if it is grey (CV_8UC1), else what its colours (CV_8UC3, BGR) give. Throws
// std::invalid_argument for an empty image or another type.
[[nodiscard]] cv::Mat gray_of(const cv::Mat& image);

}  // namespace tarsier
