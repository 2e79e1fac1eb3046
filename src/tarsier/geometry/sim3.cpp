// SPDX-License-Identifier: MIT
#include "tarsier/geometry/sim3.h"

#include "tarsier/core/require.h"
#include "tarsier/linalg/decompositions.h"

#include <Eigen/LU>

#include <cmath>

namespace tarsier::geometry {
namespace {

constexpr double kMinExtentRatio = 1e-6;  // second extent of the points / first extent

// Whether a covariance has at least two directions of extent. Extents are the roots of its singular
// values.
bool has_rank_two(const Eigen::Matrix3d& covariance) {
  const Eigen::VectorXd w = linalg::left_svd(covariance).values;
  return w[0] > 0 && std::isfinite(w[0]) && w[1] > kMinExtentRatio * kMinExtentRatio * w[0];
}

}  // namespace

Eigen::Vector3d Sim3::operator*(const Eigen::Vector3d& x) const {
  return scale * (rotation * x) + translation;
}

Sim3 Sim3::operator*(const Sim3& other) const {
  return {scale * other.scale, rotation * other.rotation, *this * other.translation};
}

Sim3 Sim3::inverse() const {
  return {1 / scale, rotation.transpose(), rotation.transpose() * translation / -scale};
}

void Sim3::check() const {
  TARSIER_REQUIRE(scale > 0 && std::isfinite(scale), "scale {}", scale);
  Rigid3{rotation, translation}.check();
}

Rigid3 moved_camera(const Rigid3& camera_from_a, const Sim3& b_from_a) {
  const Eigen::Matrix3d rotation = camera_from_a.rotation * b_from_a.rotation.transpose();
  return {rotation, b_from_a.scale * camera_from_a.translation - rotation * b_from_a.translation};
}

std::optional<Sim3> similarity_between(const PointsRef& from, const PointsRef& to) {
  TARSIER_REQUIRE(from.cols() == to.cols(), "{} and {} points", from.cols(), to.cols());
  TARSIER_REQUIRE(from.allFinite() && to.allFinite(), "a point is not finite");
  if (from.cols() < 3) return std::nullopt;
  const auto count = static_cast<double>(from.cols());
  const Eigen::Vector3d mean_from = from.rowwise().mean();
  const Eigen::Vector3d mean_to = to.rowwise().mean();
  const Eigen::Matrix3Xd a = from.colwise() - mean_from;
  const Eigen::Matrix3Xd b = to.colwise() - mean_to;
  const Eigen::Matrix3d from_covariance = a * a.transpose() / count;
  const Eigen::Matrix3d to_covariance = b * b.transpose() / count;
  const Eigen::Matrix3d cross_covariance = b * a.transpose() / count;
  if (!has_rank_two(from_covariance) || !has_rank_two(to_covariance) ||
      !has_rank_two(cross_covariance))
    return std::nullopt;
  Sim3 result;
  result.rotation = nearest_rotation(cross_covariance);
  result.scale = (result.rotation.transpose() * cross_covariance).trace() / from_covariance.trace();
  if (!(result.scale > 0) || !std::isfinite(result.scale)) return std::nullopt;
  result.translation = mean_to - result.scale * (result.rotation * mean_from);
  return result;
}

}  // namespace tarsier::geometry
