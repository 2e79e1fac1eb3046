// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/triangulation.h"

#include <algorithm>
#include <cmath>

namespace tarsier::sfm {
namespace {

constexpr int kSteps = 5;

// Solves a symmetric 3x3 system; empty where it is singular.
std::optional<cv::Vec3d> solve(const cv::Matx33d& a, const cv::Vec3d& b) {
  bool good = false;
  const cv::Matx33d inverse = a.inv(cv::DECOMP_CHOLESKY, &good);
  if (!good) return std::nullopt;
  const cv::Vec3d x = inverse * b;
  if (!std::isfinite(x[0]) || !std::isfinite(x[1]) || !std::isfinite(x[2])) return std::nullopt;
  return x;
}

bool in_front_of_all(const std::vector<ObservationRay>& rays, const cv::Vec3d& point) {
  return std::all_of(rays.begin(), rays.end(),
                     [&](const ObservationRay& seen) { return (seen.pose * point)[2] > 1e-9; });
}

}  // namespace

std::optional<cv::Vec3d> triangulate(const std::vector<ObservationRay>& rays) {
  if (rays.size() < 2) return std::nullopt;
  // Linear: u (r3 x + t3) = r1 x + t1, each row scaled by nothing but the unit ray.
  cv::Matx33d normal = cv::Matx33d::zeros();
  cv::Vec3d right;
  for (const ObservationRay& seen : rays) {
    const cv::Matx33d& r = seen.pose.rotation;
    const cv::Vec3d& t = seen.pose.translation;
    const double weight = 1 / (1 + seen.ray.dot(seen.ray));
    for (int k = 0; k < 2; ++k) {
      const double u = k == 0 ? seen.ray.x : seen.ray.y;
      const cv::Vec3d row(u * r(2, 0) - r(k, 0), u * r(2, 1) - r(k, 1), u * r(2, 2) - r(k, 2));
      const double value = t[k] - u * t[2];
      normal += weight * row * row.t();
      right += weight * value * row;
    }
  }
  std::optional<cv::Vec3d> point = solve(normal, right);
  if (!point || !in_front_of_all(rays, *point)) return std::nullopt;

  for (int step = 0; step < kSteps; ++step) {
    cv::Matx33d hessian = cv::Matx33d::zeros();
    cv::Vec3d gradient;
    for (const ObservationRay& seen : rays) {
      const cv::Vec3d p = seen.pose * *point;
      if (p[2] <= 1e-9) return std::nullopt;
      const cv::Matx23d by_camera(1 / p[2], 0, -p[0] / (p[2] * p[2]), 0, 1 / p[2],
                                  -p[1] / (p[2] * p[2]));
      const cv::Matx23d jacobian = by_camera * seen.pose.rotation;
      const cv::Vec2d residual(p[0] / p[2] - seen.ray.x, p[1] / p[2] - seen.ray.y);
      hessian += jacobian.t() * jacobian;
      gradient += jacobian.t() * residual;
    }
    const auto change = solve(hessian, gradient);
    if (!change) return std::nullopt;
    *point -= *change;
    if (cv::norm(*change) < 1e-10 * cv::norm(*point)) break;
  }
  if (!in_front_of_all(rays, *point)) return std::nullopt;
  return point;
}

double ray_angle(const cv::Vec3d& point, const cv::Vec3d& center, const cv::Vec3d& other) {
  const cv::Vec3d a = point - center;
  const cv::Vec3d b = point - other;
  return std::atan2(cv::norm(a.cross(b)), a.dot(b));
}

}  // namespace tarsier::sfm
