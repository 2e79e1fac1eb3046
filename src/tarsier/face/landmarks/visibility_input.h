// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/landmarks/visibility.h"

namespace tarsier::face::landmarks {

// The network's input, into workspace.input. Internal to this module.
void visibility_input(const Eigen::Matrix2Xd& mean, const cv::Mat& gray,
                      const Eigen::Matrix2Xd& points, VisibilityWorkspace& workspace);

}  // namespace tarsier::face::landmarks
