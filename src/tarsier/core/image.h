// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/require.h"

#include <opencv2/core/mat.hpp>

namespace tarsier {

// Throws std::invalid_argument unless `image` is a non-empty 8-bit BGR image (CV_8UC3).
inline void require_bgr(const cv::Mat& image) {
  TARSIER_REQUIRE(image.dims == 2 && !image.empty() && image.type() == CV_8UC3,
                  "{}x{}, type {} is not an 8-bit BGR image", image.cols, image.rows, image.type());
}

// Throws std::invalid_argument unless `image` is a non-empty 8-bit grey image (CV_8UC1).
inline void require_gray(const cv::Mat& image) {
  TARSIER_REQUIRE(image.dims == 2 && !image.empty() && image.type() == CV_8UC1,
                  "{}x{}, type {} is not an 8-bit grey image", image.cols, image.rows,
                  image.type());
}

}  // namespace tarsier
