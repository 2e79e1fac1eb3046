// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/dense/workspace.h"

#include <opencv2/core/mat.hpp>

namespace tarsier::sfm {

// Where an image shows nothing but a dark background, 255, of the size of `depth`: parts of a grey level up to
// `level` that reach the border, cover 5 % of the image or more, and have no depth in 70 % of their
// pixels or more. Depths that matching found in such a part belong to what stands before it.
[[nodiscard]] cv::Mat1b dark_background(const cv::Mat& bgr, const cv::Mat& depth, int level);

// Of a view; empty where `level` is 0, the view has no depth map or its image is missing. Throws InputError.
[[nodiscard]] cv::Mat1b dark_background(const Workspace& workspace, int view, int level);

}  // namespace tarsier::sfm
