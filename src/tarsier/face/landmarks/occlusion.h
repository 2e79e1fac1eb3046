// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::face::landmarks {

// Draws one thing before a face (CV_8UC1; points 2 x n, px): an ellipse, a rotated rectangle, an uneven
// shape, or all at one side of a line; of one tone, striped, noisy, or showing a part of `texture` (CV_8UC1 of
// any size, at least 8 px a side). Returns which points it hides: at least one, at most 70 %. The same for
// the same state of `rng`. Throws std::invalid_argument where no point lies in the image.
std::vector<bool> draw_occlusion(cv::Mat& gray, const Eigen::Matrix2Xd& points,
                                 const cv::Mat& texture, Rng& rng);

}  // namespace tarsier::face::landmarks
