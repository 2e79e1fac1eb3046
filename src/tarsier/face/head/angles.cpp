// SPDX-License-Identifier: MIT
#include "tarsier/face/head/angles.h"

#include "tarsier/core/angles.h"

#include <algorithm>
#include <cmath>

namespace tarsier::face::head {

Eigen::Matrix3d rotation_of_angles(const HeadAngles& angles) {
  const double cy = std::cos(angles.yaw_deg * kRadiansPerDegree);
  const double sy = std::sin(angles.yaw_deg * kRadiansPerDegree);
  const double cp = std::cos(angles.pitch_deg * kRadiansPerDegree);
  const double sp = std::sin(angles.pitch_deg * kRadiansPerDegree);
  const double cr = std::cos(angles.roll_deg * kRadiansPerDegree);
  const double sr = std::sin(angles.roll_deg * kRadiansPerDegree);
  const Eigen::Matrix3d by_yaw{{cy, 0, sy}, {0, 1, 0}, {-sy, 0, cy}};
  const Eigen::Matrix3d by_pitch{{1, 0, 0}, {0, cp, sp}, {0, -sp, cp}};
  const Eigen::Matrix3d by_roll{{cr, -sr, 0}, {sr, cr, 0}, {0, 0, 1}};
  return by_roll * by_pitch * by_yaw;
}

// Rx(-pitch) Ry(yaw) = [cy 0 sy; -sp sy, cp, sp cy; -cp sy, -sp, cp cy], and Rz mixes the first two
// rows: the third row gives pitch and yaw, the second column (0, cp) gives roll.
HeadAngles angles_of_rotation(const Eigen::Matrix3d& r) {
  HeadAngles angles;
  const double level = std::hypot(r(0, 1), r(1, 1));
  angles.pitch_deg = std::atan2(-r(2, 1), level) / kRadiansPerDegree;
  if (level > 1e-9) {
    angles.yaw_deg = std::atan2(-r(2, 0), r(2, 2)) / kRadiansPerDegree;
    angles.roll_deg = std::atan2(-r(0, 1), r(1, 1)) / kRadiansPerDegree;
  } else {
    angles.yaw_deg = std::atan2(r(0, 2), r(0, 0)) / kRadiansPerDegree;
  }
  return angles;
}

}  // namespace tarsier::face::head
