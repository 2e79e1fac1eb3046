// SPDX-License-Identifier: MIT
#include "tarsier/media/gray_image.h"

#include "tarsier/core/require.h"

#include <opencv2/imgproc.hpp>

namespace tarsier {

cv::Mat gray_of(const cv::Mat& image) {
  TARSIER_REQUIRE(!image.empty() && (image.type() == CV_8UC3 || image.type() == CV_8UC1),
                  "an image of {}x{}, type {}", image.cols, image.rows, image.type());
  if (image.channels() == 1) return image;
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

}  // namespace tarsier
