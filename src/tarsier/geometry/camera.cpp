// SPDX-License-Identifier: MIT
#include "tarsier/geometry/camera.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <cmath>

namespace tarsier::geometry {
namespace {

struct Distorted {
  cv::Point2d point;
  cv::Matx22d derivative;  // of the point, by x and y
};

Distorted distort(const std::array<double, 5>& k, const cv::Point2d& p) {
  const double x = p.x;
  const double y = p.y;
  const double r2 = x * x + y * y;
  const double radial = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
  const double slope = k[0] + r2 * (2 * k[1] + r2 * 3 * k[4]);  // of radial, by r2
  const double p1 = k[2];
  const double p2 = k[3];
  Distorted result;
  result.point = {x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
                  y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y};
  const double mixed = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y;
  result.derivative = {radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x, mixed,  //
                       mixed, radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x};
  return result;
}

// Whether the distorted radius grows all the way from the middle to the squared radius `end`.
// Behind a turning point the equation has solutions too, but no light takes them.
bool grows_up_to(const std::array<double, 5>& k, double end) {
  const double a = 3 * k[0];
  const double b = 5 * k[1];
  const double c = 7 * k[4];
  const auto positive = [&](double s) {
    return !(s > 0 && s <= end) || 1 + s * (a + s * (b + s * c)) > 0;
  };
  if (!positive(end)) return false;
  // Between the ends the slope is least where its own derivative, a + 2 b s + 3 c s2, is zero.
  if (c == 0) return b == 0 || positive(-a / (2 * b));
  const double inside = b * b - 3 * a * c;
  if (inside < 0) return true;
  const double root = std::sqrt(inside);
  return positive((-b + root) / (3 * c)) && positive((-b - root) / (3 * c));
}

}  // namespace

void Camera::check() const {
  TARSIER_REQUIRE(width > 0 && height > 0, "size {}x{} px", width, height);
  TARSIER_REQUIRE(fx > 0 && fy > 0 && std::isfinite(fx) && std::isfinite(fy),
                  "focal lengths {}, {} px", fx, fy);
  TARSIER_REQUIRE(std::isfinite(cx) && std::isfinite(cy), "principal point ({}, {})", cx, cy);
  for (const double k : distortion) TARSIER_REQUIRE(std::isfinite(k), "distortion {}", k);
  TARSIER_REQUIRE(std::isfinite(rms), "rms {} px", rms);
}

cv::Point2d Camera::pixel_of(const cv::Point2d& normalized) const {
  const cv::Point2d p = is_distorted() ? distort(distortion, normalized).point : normalized;
  return {fx * p.x + cx, fy * p.y + cy};
}

std::optional<cv::Point2d> Camera::normalized_of(const cv::Point2d& pixel) const {
  const cv::Point2d wanted((pixel.x - cx) / fx, (pixel.y - cy) / fy);
  if (!std::isfinite(wanted.x) || !std::isfinite(wanted.y)) return std::nullopt;
  if (!is_distorted()) return wanted;

  const double scale = 1 + cv::norm(wanted);
  cv::Point2d found = wanted;
  Distorted here = distort(distortion, found);
  double error = cv::norm(here.point - wanted);
  for (int iteration = 0; iteration < 100 && error > 4e-16 * scale; ++iteration) {
    const cv::Matx22d& d = here.derivative;
    const double determinant = d(0, 0) * d(1, 1) - d(0, 1) * d(1, 0);
    const cv::Point2d off = here.point - wanted;
    cv::Point2d step((d(1, 1) * off.x - d(0, 1) * off.y) / determinant,
                     (d(0, 0) * off.y - d(1, 0) * off.x) / determinant);
    if (!std::isfinite(step.x) || !std::isfinite(step.y)) return std::nullopt;
    // A step that makes it worse went too far: half of it, and so on.
    bool better = false;
    for (int halving = 0; halving < 30 && !better; ++halving) {
      const Distorted next = distort(distortion, found - step);
      const double next_error = cv::norm(next.point - wanted);
      better = next_error < error;
      if (better) {
        found -= step;
        here = next;
        error = next_error;
      }
      step *= 0.5;
    }
    if (!better) break;  // rounding, or a dead end
  }
  const cv::Matx22d& d = here.derivative;
  const bool is_regular = d(0, 0) + d(1, 1) > 0 && d(0, 0) * d(1, 1) - d(0, 1) * d(1, 0) > 0;
  if (!(error <= 1e-12 * scale) || !is_regular || !grows_up_to(distortion, found.dot(found)))
    return std::nullopt;
  return found;
}

std::optional<cv::Point2d> Camera::project(const cv::Vec3d& in_camera) const {
  if (!(in_camera[2] > 0)) return std::nullopt;
  return pixel_of({in_camera[0] / in_camera[2], in_camera[1] / in_camera[2]});
}

}  // namespace tarsier::geometry
