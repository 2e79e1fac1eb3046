// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/rigid3.h"

#include <Eigen/Core>

#include <optional>
#include <span>

namespace tarsier::geometry {

// A similarity: x_in_b = scale * rotation * x_in_a + translation; scale > 0. The translation is in
// the unit of b.
struct Sim3 {
  double scale = 1;
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();

  [[nodiscard]] Eigen::Vector3d operator*(const Eigen::Vector3d& x) const;
  // c_from_a = c_from_b * b_from_a.
  [[nodiscard]] Sim3 operator*(const Sim3& other) const;
  // a_from_b.
  [[nodiscard]] Sim3 inverse() const;
  // Throws std::invalid_argument unless scale > 0, the rotation is orthonormal (to 1e-6) and
  // right-handed and all values are finite.
  void check() const;
};

// The camera pose camera_from_b after the points of a are moved into b. For x_c = R x_a + t and x_b
// = s Q x_a + u it is R Q' x_b + (s t - R Q' u), up to the factor 1 / s, which no pixel depends on.
[[nodiscard]] Rigid3 moved_camera(const Rigid3& camera_from_a, const Sim3& b_from_a);

using PointsRef = Eigen::Ref<const Eigen::Matrix3Xd>;

// Points as the columns of a 3 x n matrix, without a copy.
[[nodiscard]] inline Eigen::Map<const Eigen::Matrix3Xd> columns_of(
    std::span<const Eigen::Vector3d> points) {
  return {points.empty() ? nullptr : points.front().data(), 3,
          static_cast<Eigen::Index>(points.size())};
}

// The similarity that maps the columns of `from` to those of `to` with the minimum sum of squared
// distances (Umeyama, PAMI 1991, eq. 40-42). For mirrored data it is the best rotation, never a
// reflection. Empty for fewer than three points, or if the points do not determine it: all `from`
// or all `to` are collinear (to within 1e-6 of their extent), or the two sets are not correlated.
// Throws std::invalid_argument for different numbers of points and for non-finite coordinates.
[[nodiscard]] std::optional<Sim3> similarity_between(const PointsRef& from, const PointsRef& to);

}  // namespace tarsier::geometry
