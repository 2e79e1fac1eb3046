// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/head/angles.h"

#include <Eigen/Core>

// Uncertainty of a head's angles. The error of a rotation R is a small rotation vector w in the
// camera's frame: the true rotation is exp([w]x) R. With R = Rz(roll) Rx(-pitch) Ry(yaw),
//   d(yaw, pitch, roll) = A w,
//   A = [0, 1 / cos pitch, 0; -1, 0, 0; 0, tan pitch, 1] Rz(roll)^T,
// so that the covariance of the angles is A cov(w) A^T (first-order propagation: Hartley and
// Zisserman, Multiple View Geometry in Computer Vision, 2nd edition 2004, section 5.2).
namespace tarsier::face::head {

// Covariance of (yaw, pitch, roll), deg^2, from cov(w), rad^2. Near a pitch of +-90 degrees, where
// yaw and roll coincide, cos pitch is limited to at least 0.01.
[[nodiscard]] Eigen::Matrix3d angle_covariance(const HeadAngles& angles,
                                               const Eigen::Matrix3d& rotation_covariance);

// The inverse: covariance of w, rad^2, from that of the angles, deg^2.
[[nodiscard]] Eigen::Matrix3d rotation_covariance(const HeadAngles& angles,
                                                  const Eigen::Matrix3d& angle_covariance);

// Correction of a computed covariance for the errors of real landmarks: errors of neighbouring
// landmarks are similar, and some do not show in the points. A variance s^2 of an axis becomes
//   (factor s)^2 + floor_deg^2.
struct AxisCalibration {
  double factor = 1;     // > 0
  double floor_deg = 0;  // >= 0
};
struct AngleCalibration {
  AxisCalibration yaw;
  AxisCalibration pitch;
  AxisCalibration roll;
};

[[nodiscard]] inline Eigen::Vector3d floor_of(const AngleCalibration& c) {
  return {c.yaw.floor_deg, c.pitch.floor_deg, c.roll.floor_deg};
}

// Covariance of (yaw, pitch, roll), deg^2.
[[nodiscard]] Eigen::Matrix3d calibrated(const Eigen::Matrix3d& angle_covariance,
                                         const AngleCalibration& calibration);

}  // namespace tarsier::face::head
