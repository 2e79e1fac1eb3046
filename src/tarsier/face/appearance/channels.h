// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/similarity.h"

#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <string_view>

namespace tarsier::face::appearance {

// The features that an appearance model computes at each pixel of an upright crop.
//  kGrey      brightness
//  kColour    blue, green, red
//  kGradient  gradient / sqrt(|gradient|^2 + e^2): the direction of strong gradients (Cootes and
//             Taylor, "On representing edge structure for model matching", CVPR 2001)
//  kOriented  eight half-wave rectified projections of the gradient (Tola et al., "DAISY", PAMI
//             2010), pooled over a few pixels and normalised together over a few more
enum class Channels { kGrey, kColour, kGradient, kOriented };

[[nodiscard]] int channel_count(Channels channels);
[[nodiscard]] std::string_view name_of(Channels channels);     // "grey" ..
[[nodiscard]] Channels parse_channels(std::string_view name);  // throws std::invalid_argument
// Brightness has an unknown offset (its mean is subtracted); features do not.
[[nodiscard]] bool has_offset(Channels channels);

// The features of a crop in which the object is upright and of the model's size.
struct UprightCrop {
  cv::Mat values;  // CV_32FC(channel_count)
  cv::Mat inside;  // CV_8UC1, 255 where the crop is inside the image; empty: everywhere
  cv::Mat buffers[4];
};

// Crops `size` pixels from `image` (CV_8UC1 or CV_8UC3); pixel x of the crop is at
// image_from_crop(x). The image is smoothed when it is reduced. Outside the image, the border is
// replicated.
void make_upright_crop(const cv::Mat& image, const shape::Similarity2d& image_from_crop,
                       cv::Size size, Channels channels, UprightCrop& upright);

}  // namespace tarsier::face::appearance
