// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <array>
#include <span>

namespace tarsier::geometry {

// A rigid motion: x_in_b = rotation * x_in_a + translation. For a pose, b is the camera and a the
// world or the object. The translation has the unit of the points.
struct Rigid3 {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  [[nodiscard]] Eigen::Vector3d operator*(const Eigen::Vector3d& x) const;
  // Applies the motion to each column, 3 x n.
  [[nodiscard]] Eigen::Matrix3Xd apply(const Eigen::Matrix3Xd& points) const;
  // c_from_a = c_from_b * b_from_a.
  [[nodiscard]] Rigid3 operator*(const Rigid3& other) const;
  // a_from_b.
  [[nodiscard]] Rigid3 inverse() const;
  // The origin of b in a: for a camera pose, the camera's centre in the world.
  [[nodiscard]] Eigen::Vector3d center() const;
  // Throws std::invalid_argument unless the rotation is orthonormal (to 1e-6) and right-handed and
  // all values are finite.
  void check() const;
};

// Whether all elements of R R' - I are within `tolerance`, and det R > 0; false for non-finite
// numbers.
[[nodiscard]] bool is_rotation(const Eigen::Matrix3d& r, double tolerance = 1e-6);

// Converts a rotation matrix to a unit quaternion (w, x, y, z), w >= 0, and a quaternion of any
// length to a matrix. Throw std::invalid_argument for non-finite numbers and for length 0.
[[nodiscard]] Eigen::Vector4d quaternion_of(const Eigen::Matrix3d& rotation);
[[nodiscard]] Eigen::Matrix3d rotation_of(const Eigen::Vector4d& quaternion);

// Converts a rotation to Rodrigues' vector: its direction is the axis, its length the angle in
// radians, 0..pi. And back, from a vector of any length.
[[nodiscard]] Eigen::Vector3d rotation_vector(const Eigen::Matrix3d& rotation);
[[nodiscard]] Eigen::Matrix3d rotation_by(const Eigen::Vector3d& rotation_vector);

// Angle of a rotation, radians, 0..pi.
[[nodiscard]] double angle_of(const Eigen::Matrix3d& rotation);

// Interpolates from rotation a (part 0) to b (part 1) along the shorter way, at constant speed
// (Shoemake, "Animating rotation with quaternion curves", SIGGRAPH 1985).
[[nodiscard]] Eigen::Matrix3d interpolate(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b,
                                          double part);

// The rotation R that maximises trace(R' M). For M = sum_i b_i a_i' it rotates the a_i to the b_i
// with the minimum sum of squared distances (Kabsch, Acta Cryst. A 1976). It is always a rotation,
// even if a reflection would fit better.
[[nodiscard]] Eigen::Matrix3d nearest_rotation(const Eigen::Matrix3d& m);

// The nine numbers of a matrix in row-major order, as in files and JSON, and back.
[[nodiscard]] std::array<double, 9> row_major(const Eigen::Matrix3d& matrix);
[[nodiscard]] Eigen::Matrix3d from_row_major(std::span<const double, 9> numbers);

// The twelve numbers of a motion, as in binary files: the rotation in row-major order, then the
// translation; and back.
[[nodiscard]] std::array<double, 12> packed(const Rigid3& motion);
[[nodiscard]] Rigid3 unpacked(const std::array<double, 12>& numbers);

}  // namespace tarsier::geometry
