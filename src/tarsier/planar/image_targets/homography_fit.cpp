// SPDX-License-Identifier: MIT
#include "tarsier/planar/image_targets/homography_fit.h"

#include "tarsier/geometry/planar_pose.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace tarsier::planar::image_targets {
namespace {

using Matx88d = cv::Matx<double, 8, 8>;
using Vec8d = cv::Vec<double, 8>;

// Solves the symmetric positive definite system in place (Cholesky); false if it is not positive
// definite.
bool solve(Matx88d& m, Vec8d& x, int n) {
  for (int j = 0; j < n; ++j) {
    double d = m(j, j);
    for (int k = 0; k < j; ++k) d -= m(j, k) * m(j, k);
    if (!(d > 1e-12)) return false;
    d = std::sqrt(d);
    m(j, j) = d;
    for (int i = j + 1; i < n; ++i) {
      double s = m(i, j);
      for (int k = 0; k < j; ++k) s -= m(i, k) * m(j, k);
      m(i, j) = s / d;
    }
  }
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < i; ++k) x[i] -= m(i, k) * x[k];
    x[i] /= m(i, i);
  }
  for (int i = n - 1; i >= 0; --i) {
    for (int k = i + 1; k < n; ++k) x[i] -= m(k, i) * x[k];
    x[i] /= m(i, i);
  }
  return true;
}

// Moves the image's centre to 0 and scales its corners to distance 1.
cv::Matx33d centering(cv::Size size) {
  const double r = 2 / std::hypot(size.width, size.height);
  return {r, 0, -r * (size.width / 2.0 - 0.5), 0, r, -r * (size.height / 2.0 - 0.5), 0, 0, 1};
}

}  // namespace

double error_of(const cv::Matx33d& h, const Correspondence& s) {
  const cv::Point2d d = s.seen - geometry::mapped(h, s.at);
  return std::sqrt(std::max(0.0, s.a * d.x * d.x + 2 * s.b * d.x * d.y + s.c * d.y * d.y));
}

bool fit_homography(cv::Matx33d& h, cv::Size size, std::span<const Correspondence> correspondences,
                    const HomographyFitOptions& options) {
  options.check();
  const cv::Matx33d normal = centering(size);
  cv::Matx33d g = h * normal.inv();
  if (!(std::abs(g(2, 2)) > 1e-12)) return false;
  g = g * (1 / g(2, 2));
  if (options.affine) g(2, 0) = g(2, 1) = 0;
  const double radius = 2 / std::hypot(size.width, size.height);
  const double mid_x = size.width / 2.0 - 0.5;
  const double mid_y = size.height / 2.0 - 0.5;
  const int n = options.affine ? 6 : 8;
  const double tolerance2 = options.tolerance_px * options.tolerance_px;
  const double prior =
      options.sigma_px * options.sigma_px / (options.perspective * options.perspective);
  for (int iteration = 0; iteration < options.iterations; ++iteration) {
    Matx88d m = Matx88d::zeros();
    Vec8d right = Vec8d::all(0);
    int count = 0;
    for (const Correspondence& s : correspondences) {
      const double x = (s.at.x - mid_x) * radius;
      const double y = (s.at.y - mid_y) * radius;
      const double w = g(2, 0) * x + g(2, 1) * y + 1;
      if (w < 0.1) continue;
      const double u = (g(0, 0) * x + g(0, 1) * y + g(0, 2)) / w;
      const double v = (g(1, 0) * x + g(1, 1) * y + g(1, 2)) / w;
      const double du = s.seen.x - u;
      const double dv = s.seen.y - v;
      const double e2 = s.a * du * du + 2 * s.b * du * dv + s.c * dv * dv;
      if (e2 >= tolerance2) continue;
      ++count;
      const double part = 1 - e2 / tolerance2;
      const double weight = part * part;
      const double ju[8] = {x / w, y / w, 1 / w, 0, 0, 0, -u * x / w, -u * y / w};
      const double jv[8] = {0, 0, 0, x / w, y / w, 1 / w, -v * x / w, -v * y / w};
      for (int i = 0; i < n; ++i) {
        const double pu = weight * (ju[i] * s.a + jv[i] * s.b);
        const double pv = weight * (ju[i] * s.b + jv[i] * s.c);
        right[i] += pu * du + pv * dv;
        for (int j = 0; j <= i; ++j) m(i, j) += pu * ju[j] + pv * jv[j];
      }
    }
    if (count < 3) return false;
    for (int i = 0; i < 6; ++i) m(i, i) += 1e-9;
    for (int i = 6; i < n; ++i) {
      m(i, i) += prior;
      right[i] -= prior * g(2, i - 6);
    }
    if (!solve(m, right, n)) return false;
    g(0, 0) += right[0];
    g(0, 1) += right[1];
    g(0, 2) += right[2];
    g(1, 0) += right[3];
    g(1, 1) += right[4];
    g(1, 2) += right[5];
    if (n == 8) {
      g(2, 0) += right[6];
      g(2, 1) += right[7];
    }
    if (!(cv::norm(right) < 1e6)) return false;
    if (cv::norm(right) < 1e-3) break;
  }
  const cv::Matx33d result = g * normal;
  for (const double v : result.val)
    if (!std::isfinite(v)) return false;
  h = result * (1 / result(2, 2));
  return true;
}

double corner_deviation(const cv::Matx33d& h, cv::Size size,
                        std::span<const Correspondence> correspondences, double sigma_px,
                        double perspective) {
  const cv::Matx33d normal = centering(size);
  cv::Matx33d g = h * normal.inv();
  g = g * (1 / g(2, 2));
  const auto rows = [&](const cv::Point2d& at, double ju[8], double jv[8]) {
    const cv::Vec3d n = normal * cv::Vec3d(at.x, at.y, 1);
    const cv::Vec3d p = g * n;
    const double u = p[0] / p[2];
    const double v = p[1] / p[2];
    for (int i = 0; i < 3; ++i) {
      ju[i] = jv[i + 3] = n[i] / p[2];
      ju[i + 3] = jv[i] = 0;
    }
    for (int i = 0; i < 2; ++i) {
      ju[i + 6] = -u * n[i] / p[2];
      jv[i + 6] = -v * n[i] / p[2];
    }
  };
  Matx88d m = Matx88d::zeros();
  for (const Correspondence& s : correspondences) {
    double ju[8];
    double jv[8];
    rows(s.at, ju, jv);
    for (int i = 0; i < 8; ++i)
      for (int j = 0; j < 8; ++j)
        m(i, j) += ju[i] * (s.a * ju[j] + s.b * jv[j]) + jv[i] * (s.b * ju[j] + s.c * jv[j]);
  }
  m = m * (1 / (sigma_px * sigma_px));
  for (int i = 0; i < 8; ++i) m(i, i) += i < 6 ? 1e-12 : 1 / (perspective * perspective);
  bool ok = false;
  const Matx88d covariance = m.inv(cv::DECOMP_CHOLESKY, &ok);
  if (!ok) return std::numeric_limits<double>::infinity();
  double max_variance = 0;
  const double w = size.width - 0.5;
  const double b = size.height - 0.5;
  for (const cv::Point2d corner :
       {cv::Point2d(-0.5, -0.5), cv::Point2d(w, -0.5), cv::Point2d(w, b), cv::Point2d(-0.5, b)}) {
    double j[2][8];
    rows(corner, j[0], j[1]);
    double variance = 0;
    for (const auto& row : j)
      for (int i = 0; i < 8; ++i)
        for (int k = 0; k < 8; ++k) variance += row[i] * covariance(i, k) * row[k];
    max_variance = std::max(max_variance, variance);
  }
  return std::sqrt(max_variance);
}

bool is_plausible(const cv::Matx33d& h, cv::Size size, cv::Size frame, double min_area_px) {
  const double w = size.width - 0.5;
  const double b = size.height - 0.5;
  const std::array<cv::Point2d, 4> corners = {{{-0.5, -0.5}, {w, -0.5}, {w, b}, {-0.5, b}}};
  std::array<cv::Point2d, 4> q;
  for (std::size_t i = 0; i < 4; ++i) {
    const cv::Vec3d p = h * cv::Vec3d(corners[i].x, corners[i].y, 1);
    if (!(p[2] > 1e-3)) return false;
    q[i] = {p[0] / p[2], p[1] / p[2]};
    if (!(q[i].x > -2.0 * frame.width && q[i].x < 3.0 * frame.width &&
          q[i].y > -2.0 * frame.height && q[i].y < 3.0 * frame.height)) {
      return false;
    }
  }
  double area = 0;
  double shortest = 1e12;
  double longest = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    const cv::Point2d& p = q[i];
    const cv::Point2d e = q[(i + 1) % 4] - p;
    const cv::Point2d f = q[(i + 2) % 4] - q[(i + 1) % 4];
    if (!(e.cross(f) > 0.05 * cv::norm(e) * cv::norm(f))) return false;
    area += p.cross(q[(i + 1) % 4]) / 2;
    shortest = std::min(shortest, cv::norm(e));
    longest = std::max(longest, cv::norm(e));
  }
  return area >= min_area_px && shortest * 12 > longest;
}

}  // namespace tarsier::planar::image_targets
