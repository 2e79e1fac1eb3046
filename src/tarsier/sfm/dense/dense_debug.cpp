// SPDX-License-Identifier: MIT
#include "tarsier/sfm/dense/dense_run.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

namespace tarsier::sfm {

cv::Mat draw_depth(const cv::Mat& depth) {
  std::vector<float> inverse;
  for (int y = 0; y < depth.rows; ++y)
    for (int x = 0; x < depth.cols; ++x)
      if (depth.at<float>(y, x) > 0) inverse.push_back(1 / depth.at<float>(y, x));
  cv::Mat image = cv::Mat::zeros(depth.size(), CV_8UC3);
  if (inverse.empty()) return image;
  std::sort(inverse.begin(), inverse.end());
  const float low = inverse[inverse.size() * 2 / 100];
  const float high = inverse[inverse.size() * 98 / 100];
  const float scale = high > low ? 255 / (high - low) : 0;
  cv::Mat1b part(depth.size(), static_cast<std::uint8_t>(0));
  for (int y = 0; y < depth.rows; ++y) {
    for (int x = 0; x < depth.cols; ++x) {
      const float z = depth.at<float>(y, x);
      if (z > 0) part(y, x) = cv::saturate_cast<std::uint8_t>((1 / z - low) * scale);
    }
  }
  cv::Mat colors;
  cv::applyColorMap(part, colors, cv::COLORMAP_TURBO);
  colors.copyTo(image, depth > 0);
  return image;
}

cv::Mat draw_normals(const cv::Mat& normals) {
  cv::Mat image(normals.size(), CV_8UC3);
  for (int y = 0; y < normals.rows; ++y) {
    for (int x = 0; x < normals.cols; ++x) {
      const auto& n = normals.at<cv::Vec3f>(y, x);
      for (int k = 0; k < 3; ++k) {
        image.at<cv::Vec3b>(y, x)[2 - k] =
            cv::saturate_cast<std::uint8_t>(127.5F + 127.5F * (k == 2 ? -n[k] : n[k]));
      }
    }
  }
  return image;
}

}  // namespace tarsier::sfm
