// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/landmarks/point_states.h"

namespace tarsier::face::landmarks {

// The network's input, into workspace.input. Internal to this module.
void point_state_input(const Eigen::Matrix2Xd& mean, const cv::Mat& gray,
                       const Eigen::Matrix2Xd& points, PointStateWorkspace& workspace);

}  // namespace tarsier::face::landmarks
