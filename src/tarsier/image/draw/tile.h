// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <span>
#include <string>

namespace tarsier::image::draw {

// A grid of labelled thumbnails, e.g. all stages of an algorithm. `images` are CV_8U or CV_16U
// (shown / 256) with 1, 3 or 4 channels, or CV_32F/CV_64F (scaled from their finite minimum to
// their finite maximum). Empty images leave their cell dark. Each image keeps its aspect ratio and
// is enlarged at most 4 times. `names` has the length of `images`. The number of columns maximises
// the size of the thumbnails. The result is CV_8UC3 of `size` (px, each >= 16). Throws
// std::invalid_argument for other types and sizes.
[[nodiscard]] cv::Mat tile(std::span<const cv::Mat> images, std::span<const std::string> names,
                           cv::Size size);

// Scales `image` to fit into `size` with its aspect ratio kept, and centres it on `background`;
// same types as tile().
[[nodiscard]] cv::Mat letterbox(const cv::Mat& image, cv::Size size,
                                const cv::Scalar& background = {0, 0, 0});

}  // namespace tarsier::image::draw
