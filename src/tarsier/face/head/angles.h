// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

// Yaw, pitch and roll of a head. Camera: x right, y down, z forward. The head's axes are the
// camera's axes when it looks straight into the camera (the nose points along -z):
//   R_camera_from_head = Rz(roll) Rx(-pitch) Ry(yaw),
// Rx(a) = [1 0 0; 0 cos a -sin a; 0 sin a cos a], Ry(a) = [cos a 0 sin a; 0 1 0; -sin a 0 cos a],
// Rz(a) = [cos a -sin a 0; sin a cos a 0; 0 0 1].
// yaw > 0: the head turns to image left; pitch > 0: up; roll > 0: clockwise in the image.
namespace tarsier::face::head {

struct HeadAngles {
  double yaw_deg = 0;    // (-180, 180]
  double pitch_deg = 0;  // [-90, 90]
  double roll_deg = 0;   // (-180, 180]
};

[[nodiscard]] Eigen::Matrix3d rotation_of_angles(const HeadAngles& angles);

// The inverse. At a pitch of +-90 degrees only yaw -+ roll is determined; roll is then 0.
[[nodiscard]] HeadAngles angles_of_rotation(const Eigen::Matrix3d& camera_from_head);

}  // namespace tarsier::face::head
