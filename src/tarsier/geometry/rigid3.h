// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <array>
#include <span>

namespace tarsier::geometry {

// A rigid motion: x_in_b = rotation * x_in_a + translation. Of a pose b is the camera and a the world or the object;
// the unit is that of the points.
struct Rigid3 {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  [[nodiscard]] Eigen::Vector3d operator*(const Eigen::Vector3d& x) const {
    return rotation * x + translation;
  }
  // Of each column, 3 x n.
  [[nodiscard]] Eigen::Matrix3Xd apply(const Eigen::Matrix3Xd& points) const {
    return (rotation * points).colwise() + translation;
  }
  // c_from_a = c_from_b * b_from_a.
  [[nodiscard]] Rigid3 operator*(const Rigid3& other) const {
    return {rotation * other.rotation, rotation * other.translation + translation};
  }
  // a_from_b.
  [[nodiscard]] Rigid3 inverse() const { return {rotation.transpose(), center()}; }
  // Where b's origin lies in a: a camera's centre in the world.
  [[nodiscard]] Eigen::Vector3d center() const { return -(rotation.transpose() * translation); }
  // Throws std::invalid_argument unless the rotation is orthonormal (to 1e-6) and right-handed and all is finite.
  void check() const;
};

// Whether no number of R R' - I is beyond `tolerance`, and det R > 0; false for numbers that are not finite.
[[nodiscard]] bool is_rotation(const Eigen::Matrix3d& r, double tolerance = 1e-6);

// Unit quaternion (w, x, y, z), w >= 0, of a rotation matrix, and back from one of any length. Throw
// std::invalid_argument for numbers that are not finite and for length 0.
[[nodiscard]] Eigen::Vector4d quaternion_of(const Eigen::Matrix3d& rotation);
[[nodiscard]] Eigen::Matrix3d rotation_of(const Eigen::Vector4d& quaternion);

// Rodrigues' vector of a rotation: its axis, as long as its angle in radians, 0..pi; and back from one of any length.
[[nodiscard]] Eigen::Vector3d rotation_vector(const Eigen::Matrix3d& rotation);
[[nodiscard]] Eigen::Matrix3d rotation_by(const Eigen::Vector3d& rotation_vector);

// Angle of a rotation, radians, 0..pi.
[[nodiscard]] double angle_of(const Eigen::Matrix3d& rotation);

// From rotation a (part 0) towards b (part 1) along the shorter way, at even speed (Shoemake, "Animating rotation with
// quaternion curves", SIGGRAPH 1985).
[[nodiscard]] Eigen::Matrix3d interpolate(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b,
                                          double part);

// The rotation R that maximises trace(R' M): of M = sum_i b_i a_i' it turns the a_i onto the b_i with the least sum of
// squared distances (Kabsch, Acta Cryst. A 1976). A rotation also where a reflection would fit better.
[[nodiscard]] Eigen::Matrix3d nearest_rotation(const Eigen::Matrix3d& m);

// The nine numbers of a matrix row by row, as files and JSON have them, and back.
[[nodiscard]] std::array<double, 9> row_major(const Eigen::Matrix3d& matrix);
[[nodiscard]] Eigen::Matrix3d from_row_major(std::span<const double, 9> numbers);

// The twelve numbers of a motion, as binary files have them: the rotation row by row, then the translation; and back.
[[nodiscard]] std::array<double, 12> packed(const Rigid3& motion);
[[nodiscard]] Rigid3 unpacked(const std::array<double, 12>& numbers);

}  // namespace tarsier::geometry
