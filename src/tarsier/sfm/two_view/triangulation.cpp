// SPDX-License-Identifier: MIT
#include "tarsier/sfm/two_view/triangulation.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <limits>

namespace tarsier::sfm {
namespace {

constexpr int kSteps = 5;

// Solves a symmetric 3x3 system; empty where it is singular.
std::optional<Eigen::Vector3d> solve(const Eigen::Matrix3d& a, const Eigen::Vector3d& b) {
  const Eigen::LLT<Eigen::Matrix3d> factor(a);
  if (factor.info() != Eigen::Success) return std::nullopt;
  const double pivot = factor.matrixLLT().diagonal().minCoeff();
  if (pivot * pivot < std::numeric_limits<double>::epsilon()) return std::nullopt;
  const Eigen::Vector3d x = factor.solve(b);
  if (!x.allFinite()) return std::nullopt;
  return x;
}

bool in_front_of_all(const std::vector<ObservationRay>& rays, const Eigen::Vector3d& point) {
  return std::all_of(rays.begin(), rays.end(),
                     [&](const ObservationRay& seen) { return (seen.pose * point)[2] > 1e-9; });
}

}  // namespace

std::optional<Eigen::Vector3d> triangulate(const std::vector<ObservationRay>& rays) {
  if (rays.size() < 2) return std::nullopt;
  // Linear: u (r3 x + t3) = r1 x + t1, each row weighted as for a unit ray.
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const ObservationRay& seen : rays) {
    const Eigen::Matrix3d& r = seen.pose.rotation;
    const Eigen::Vector3d& t = seen.pose.translation;
    const double weight = 1 / (1 + seen.ray.dot(seen.ray));
    for (int k = 0; k < 2; ++k) {
      const double u = k == 0 ? seen.ray.x : seen.ray.y;
      const Eigen::Vector3d row = u * r.row(2) - r.row(k);
      const double value = t[k] - u * t[2];
      normal += weight * row * row.transpose();
      right += weight * value * row;
    }
  }
  std::optional<Eigen::Vector3d> point = solve(normal, right);
  if (!point || !in_front_of_all(rays, *point)) return std::nullopt;

  for (int step = 0; step < kSteps; ++step) {
    Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    for (const ObservationRay& seen : rays) {
      const Eigen::Vector3d p = seen.pose * *point;
      if (p[2] <= 1e-9) return std::nullopt;
      Eigen::Matrix<double, 2, 3> by_camera;
      by_camera << 1 / p[2], 0, -p[0] / (p[2] * p[2]), 0, 1 / p[2], -p[1] / (p[2] * p[2]);
      const Eigen::Matrix<double, 2, 3> jacobian = by_camera * seen.pose.rotation;
      const Eigen::Vector2d residual(p[0] / p[2] - seen.ray.x, p[1] / p[2] - seen.ray.y);
      hessian += jacobian.transpose() * jacobian;
      gradient += jacobian.transpose() * residual;
    }
    const auto change = solve(hessian, gradient);
    if (!change) return std::nullopt;
    *point -= *change;
    if (change->norm() < 1e-10 * point->norm()) break;
  }
  if (!in_front_of_all(rays, *point)) return std::nullopt;
  return point;
}

double ray_angle(const Eigen::Vector3d& point, const Eigen::Vector3d& center,
                 const Eigen::Vector3d& other) {
  const Eigen::Vector3d a = point - center;
  const Eigen::Vector3d b = point - other;
  return std::atan2(a.cross(b).norm(), a.dot(b));
}

}  // namespace tarsier::sfm
