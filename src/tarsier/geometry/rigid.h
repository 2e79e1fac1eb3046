// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

namespace tarsier::geometry {

// x_b = rotation * x_a + translation. For an image b is its camera and a the world.
struct Rigid {
  cv::Matx33d rotation = cv::Matx33d::eye();
  cv::Vec3d translation{};

  [[nodiscard]] cv::Vec3d operator*(const cv::Vec3d& x) const { return rotation * x + translation; }
  [[nodiscard]] Rigid operator*(const Rigid& other) const {
    return {rotation * other.rotation, rotation * other.translation + translation};
  }
  [[nodiscard]] Rigid inverse() const {
    const cv::Matx33d back = rotation.t();
    return {back, -(back * translation)};
  }
  // Where b's origin lies in a: a camera's centre in the world.
  [[nodiscard]] cv::Vec3d center() const { return -(rotation.t() * translation); }
};

// Unit quaternion (w, x, y, z), w >= 0, of a rotation matrix, and back.
[[nodiscard]] cv::Vec4d quaternion_of(const cv::Matx33d& rotation);
[[nodiscard]] cv::Matx33d rotation_of(const cv::Vec4d& quaternion);

// Angle of a rotation, radians, 0..pi.
[[nodiscard]] double angle_of(const cv::Matx33d& rotation);

}  // namespace tarsier::geometry
