// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/landmark_set.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <optional>
#include <vector>

namespace tarsier::face::shape {

// The part of an image that training keeps: around the points, reduced.
struct AnnotatedCrop {
  cv::Mat image;
  Eigen::Matrix2Xd points;        // px of `image`, pixel centres at integers
  std::optional<cv::Rect2d> box;  // px of `image`
  double scale = 1;               // px of the whole image per px of `image`
};

// Crops the points' box with a margin of `margin` times its larger side (0 or more), reduced (never
// enlarged) until that side is at most `largest` px. If that part is empty, the whole image is
// used. Pixel centres are kept: pixel k of an image reduced to `s` of its size has its centre at (k
// + 0.5) / s - 0.5. `image` may have any number of channels; no point may be missing.
[[nodiscard]] AnnotatedCrop crop_around_points(const cv::Mat& image, const LandmarkSample& sample,
                                               double margin, int largest);

// The same object in the mirrored image. `to_the_right` is the horizontal offset of the points from
// a mirror-symmetric annotation (px of the whole image; 1 if pixels were counted from 1). The
// mirrored points get the same offset. Throws std::invalid_argument for different sizes.
[[nodiscard]] AnnotatedCrop mirrored(const AnnotatedCrop& crop, const std::vector<int>& mirror,
                                     double to_the_right);

}  // namespace tarsier::face::shape
