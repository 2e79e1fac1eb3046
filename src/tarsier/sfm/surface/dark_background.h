// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/dense/workspace.h"

#include <opencv2/core/mat.hpp>

namespace tarsier::sfm {

// Mask (255) of the dark background of an image, in the size of `depth`. It consists of connected
// parts of grey levels up to `level` that touch the border. Each covers at least 5 % of the image
// and lacks depth in at least 70 % of its pixels. Depths that matching found in such a part belong
// to the object in front of it.
[[nodiscard]] cv::Mat1b dark_background(const cv::Mat& bgr, const cv::Mat& depth, int level);

// The mask of a view; empty where `level` is 0, the view has no depth map or its image is missing.
// Throws InputError.
[[nodiscard]] cv::Mat1b dark_background(const Workspace& workspace, int view, int level);

}  // namespace tarsier::sfm
