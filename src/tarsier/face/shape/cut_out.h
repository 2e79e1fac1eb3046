// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/shape/landmark_set.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <opencv2/core/types.hpp>

#include <optional>
#include <vector>

namespace tarsier::face::shape {

// What training keeps of an image: the part around the points, reduced.
struct CutOut {
  cv::Mat image;
  Eigen::Matrix2Xd points;        // px of `image`, centres at integers
  std::optional<cv::Rect2d> box;  // px of `image`
  double scale = 1;               // px of the whole image to a px of `image`
};

// The points' box with a margin of `margin` times its larger side (0 or more), reduced (never
// enlarged) until that side is at most `largest` px; the whole image where that part is empty.
// Pixel centres stay where they were: pixel k of an image reduced to `s` of its size has its
// centre at (k + 0.5) / s - 0.5. `image` may have any number of channels; no point may be missing.
[[nodiscard]] CutOut cut_out(const cv::Mat& image, const LandmarkSample& sample, double margin,
                             int largest);

// The same object as it is in its mirrored image. Where the points lie `to_the_right` of where a
// mirror-symmetric annotation has them (px of the whole image; 1 where pixels were counted from
// 1), the mirrored ones do so too. Throws std::invalid_argument where the sizes disagree.
[[nodiscard]] CutOut mirrored(const CutOut& cut, const std::vector<int>& mirror,
                              double to_the_right);

}  // namespace tarsier::face::shape
