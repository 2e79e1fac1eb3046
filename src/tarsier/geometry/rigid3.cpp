// SPDX-License-Identifier: MIT
#include "tarsier/geometry/rigid3.h"

#include "tarsier/core/require.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>

#include <cmath>

namespace tarsier::geometry {
namespace {

using RowMajor = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

Eigen::Quaterniond normalized(const Eigen::Quaterniond& q) {
  const double length = q.norm();
  TARSIER_REQUIRE(length > 0 && std::isfinite(length), "quaternion of length {}", length);
  return Eigen::Quaterniond(q.coeffs() / length);
}

}  // namespace

Eigen::Vector3d Rigid3::operator*(const Eigen::Vector3d& x) const {
  return rotation * x + translation;
}

Eigen::Matrix3Xd Rigid3::apply(const Eigen::Matrix3Xd& points) const {
  return (rotation * points).colwise() + translation;
}

Rigid3 Rigid3::operator*(const Rigid3& other) const {
  return {rotation * other.rotation, rotation * other.translation + translation};
}

Rigid3 Rigid3::inverse() const { return {rotation.transpose(), center()}; }

Eigen::Vector3d Rigid3::center() const { return -(rotation.transpose() * translation); }

void Rigid3::check() const {
  TARSIER_REQUIRE(is_rotation(rotation), "the rotation is not orthonormal");
  TARSIER_REQUIRE(translation.allFinite(), "the translation is not finite");
}

bool is_rotation(const Eigen::Matrix3d& r, double tolerance) {
  return r.allFinite() &&
         (r * r.transpose() - Eigen::Matrix3d::Identity()).cwiseAbs().maxCoeff() < tolerance &&
         r.determinant() > 0;
}

Eigen::Vector4d quaternion_of(const Eigen::Matrix3d& rotation) {
  const Eigen::Quaterniond q = normalized(Eigen::Quaterniond(rotation));
  return (q.w() < 0 ? -1 : 1) * Eigen::Vector4d(q.w(), q.x(), q.y(), q.z());
}

Eigen::Matrix3d rotation_of(const Eigen::Vector4d& q) {
  return normalized({q[0], q[1], q[2], q[3]}).toRotationMatrix();
}

Eigen::Vector3d rotation_vector(const Eigen::Matrix3d& rotation) {
  const Eigen::AngleAxisd turn{Eigen::Quaterniond(rotation)};
  return turn.angle() * turn.axis();
}

Eigen::Matrix3d rotation_by(const Eigen::Vector3d& v) {
  const double angle = v.norm();
  if (angle == 0) return Eigen::Matrix3d::Identity();
  return Eigen::AngleAxisd(angle, v / angle).toRotationMatrix();
}

// Uses both sine and cosine: each alone loses half its digits near one end of the range.
double angle_of(const Eigen::Matrix3d& r) {
  const Eigen::Vector3d twice_sine(r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1));
  return std::atan2(twice_sine.norm(), r.trace() - 1);
}

Eigen::Matrix3d interpolate(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b, double part) {
  const Eigen::Quaterniond from(a);
  return from.slerp(part, Eigen::Quaterniond(b)).normalized().toRotationMatrix();
}

Eigen::Matrix3d nearest_rotation(const Eigen::Matrix3d& m) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d u = svd.matrixU();
  if (u.determinant() * svd.matrixV().determinant() < 0) u.col(2) *= -1;
  return u * svd.matrixV().transpose();
}

std::array<double, 9> row_major(const Eigen::Matrix3d& matrix) {
  std::array<double, 9> numbers;
  Eigen::Map<RowMajor>(numbers.data()) = matrix;
  return numbers;
}

Eigen::Matrix3d from_row_major(std::span<const double, 9> numbers) {
  return Eigen::Map<const RowMajor>(numbers.data());
}

std::array<double, 12> packed(const Rigid3& motion) {
  std::array<double, 12> numbers;
  Eigen::Map<RowMajor>(numbers.data()) = motion.rotation;
  Eigen::Map<Eigen::Vector3d>(numbers.data() + 9) = motion.translation;
  return numbers;
}

Rigid3 unpacked(const std::array<double, 12>& numbers) {
  return {Eigen::Map<const RowMajor>(numbers.data()),
          Eigen::Map<const Eigen::Vector3d>(numbers.data() + 9)};
}

}  // namespace tarsier::geometry
