// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <span>
#include <string>

namespace tarsier::image::draw {

// A grid of labelled thumbnails: all stages of an algorithm in one image. `images` are CV_8U or
// CV_16U (shown / 256), of 1, 3 or 4 channels, or CV_32F/CV_64F (stretched from their least to
// their greatest finite value); empty ones leave their cell dark. Each keeps its aspect and is
// never enlarged beyond 4 times. `names` is as long as `images`. The number of columns is the one
// that shows them largest. The result is CV_8UC3 of `size` (px, each
// >= 16). Throws std::invalid_argument for other types and sizes.
[[nodiscard]] cv::Mat tile(std::span<const cv::Mat> images, std::span<const std::string> names,
                           cv::Size size);

// `image` scaled to fit into `size` and centred there on `background`, aspect kept; the same types
// as tile().
[[nodiscard]] cv::Mat letterbox(const cv::Mat& image, cv::Size size,
                                const cv::Scalar& background = {0, 0, 0});

}  // namespace tarsier::image::draw
