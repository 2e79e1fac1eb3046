// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/head/head_pose.h"

#include <Eigen/Core>

// Learning of the identity from the normal equations of a frame.
namespace tarsier::face::head {

// Adds the information of a frame on c with the pose eliminated; expression is noise in the same
// directions. `normal` and `right` are the normal equations of pose and shape without the prior,
// (6 + m) x (6 + m) and 6 + m, linearised at c. They are ignored if the result is not finite.
void add_frame(const Eigen::MatrixXd& normal, const Eigen::VectorXd& right,
               const Eigen::VectorXd& c, const HeadPoseOptions& options, HeadIdentity& identity);

}  // namespace tarsier::face::head
