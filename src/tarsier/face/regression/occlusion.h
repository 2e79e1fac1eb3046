// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <vector>

namespace tarsier::face::regression {

// Draws one occlusion over a face (CV_8UC1; points 2 x n, px): an ellipse, a rotated rectangle, an
// irregular shape, or everything on one side of a line. It has one tone, stripes, noise, or a part
// of `texture` (CV_8UC1 of any size, at least 8 px per side). Returns which points it hides: at
// least one, at most 70 %. Deterministic by the state of `rng`. Throws std::invalid_argument if no
// point is in the image.
std::vector<bool> draw_occlusion(cv::Mat& gray, const Eigen::Matrix2Xd& points,
                                 const cv::Mat& texture, Rng& rng);

}  // namespace tarsier::face::regression
