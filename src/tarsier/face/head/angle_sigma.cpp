// SPDX-License-Identifier: MIT
#include "tarsier/face/head/angle_sigma.h"

#include "tarsier/core/angles.h"

#include <algorithm>
#include <cmath>

namespace tarsier::face::head {
namespace {

constexpr double kMinCosine = 0.01;

// Rz(roll)^T w = (-dpitch, cos(pitch) dyaw, droll - sin(pitch) dyaw).
Eigen::Matrix3d unrolled(const HeadAngles& angles) {
  const double c = std::cos(angles.roll_deg * kRadiansPerDegree);
  const double s = std::sin(angles.roll_deg * kRadiansPerDegree);
  return Eigen::Matrix3d{{c, s, 0}, {-s, c, 0}, {0, 0, 1}};
}

double cosine_of_pitch(const HeadAngles& angles) {
  return std::max(std::cos(angles.pitch_deg * kRadiansPerDegree), kMinCosine);
}

}  // namespace

Eigen::Matrix3d angle_covariance(const HeadAngles& angles,
                                 const Eigen::Matrix3d& rotation_covariance) {
  const double cosine = cosine_of_pitch(angles);
  const double sine = std::sin(angles.pitch_deg * kRadiansPerDegree);
  const Eigen::Matrix3d of_rotation{{0, 1 / cosine, 0}, {-1, 0, 0}, {0, sine / cosine, 1}};
  const Eigen::Matrix3d jacobian = of_rotation * unrolled(angles) / kRadiansPerDegree;
  return jacobian * rotation_covariance * jacobian.transpose();
}

Eigen::Matrix3d rotation_covariance(const HeadAngles& angles,
                                    const Eigen::Matrix3d& angle_covariance) {
  const double cosine = cosine_of_pitch(angles);
  const double sine = std::sin(angles.pitch_deg * kRadiansPerDegree);
  const Eigen::Matrix3d of_angles{{0, -1, 0}, {cosine, 0, 0}, {-sine, 0, 1}};
  const Eigen::Matrix3d jacobian = unrolled(angles).transpose() * of_angles * kRadiansPerDegree;
  return jacobian * angle_covariance * jacobian.transpose();
}

Eigen::Matrix3d calibrated(const Eigen::Matrix3d& angle_covariance,
                           const AngleCalibration& calibration) {
  const Eigen::Vector3d factor(calibration.yaw.factor, calibration.pitch.factor,
                               calibration.roll.factor);
  Eigen::Matrix3d result = factor.asDiagonal() * angle_covariance * factor.asDiagonal();
  result.diagonal() += floor_of(calibration).cwiseAbs2();
  return result;
}

}  // namespace tarsier::face::head
