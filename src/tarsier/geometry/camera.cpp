// SPDX-License-Identifier: MIT
#include "tarsier/geometry/camera.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <cmath>

namespace tarsier::geometry {
namespace {

constexpr std::array<std::string_view, 3> kNames{"pinhole", "rational", "fisheye"};
constexpr std::array<std::size_t, 3> kCoefficientCounts{5, 8, 4};
constexpr int kMaxDistortionDegree = 6;

struct Distorted {
  cv::Point2d point;
  cv::Matx22d derivative;  // of the point with respect to x and y
};

Distorted distort(const std::array<double, 8>& k, const cv::Point2d& p) {
  const double x = p.x;
  const double y = p.y;
  const double r2 = x * x + y * y;
  const double numerator = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
  const double denominator = 1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]));
  const double radial = numerator / denominator;
  const double numerator_slope = k[0] + r2 * (2 * k[1] + r2 * 3 * k[4]);  // with respect to r2
  const double denominator_slope = k[5] + r2 * (2 * k[6] + r2 * 3 * k[7]);
  const double slope = (numerator_slope - radial * denominator_slope) / denominator;
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

// Coefficients in s, ascending.
struct DistortionPolynomial {
  std::array<double, kMaxDistortionDegree + 1> c{};
  int degree = 0;
};

// Whether every value on [0, 1] is positive, decided by Bernstein coefficients. The curve lies
// within their range, and begins and ends at the first and the last. If the range does not decide,
// the interval is halved.
bool is_positive(std::array<double, kMaxDistortionDegree + 1> b, int degree, int depth) {
  const auto n = static_cast<std::size_t>(degree);
  if (!(b[0] > 0) || !(b[n] > 0)) return false;
  if (std::all_of(b.begin(), b.begin() + degree + 1, [](double v) { return v > 0; })) return true;
  if (depth == 0) return false;  // touches zero to within the precision
  std::array<double, kMaxDistortionDegree + 1> left{};
  left[0] = b[0];
  // De Casteljau at 1/2; b becomes the right half.
  for (std::size_t level = 1; level <= n; ++level) {
    for (std::size_t i = 0; i + level <= n; ++i) b[i] = 0.5 * (b[i] + b[i + 1]);
    left[level] = b[0];
  }
  return is_positive(left, degree, depth - 1) && is_positive(b, degree, depth - 1);
}

bool is_positive_up_to(const DistortionPolynomial& polynomial, double end) {
  const int n = polynomial.degree;
  std::array<double, kMaxDistortionDegree + 1> scaled{};
  double power = 1;
  for (int i = 0; i <= n; ++i, power *= end)
    scaled[static_cast<std::size_t>(i)] = polynomial.c[static_cast<std::size_t>(i)] * power;
  const auto binomial = [](int m, int k) {
    double value = 1;
    for (int i = 1; i <= k; ++i) value = value * (m - k + i) / i;
    return value;
  };
  std::array<double, kMaxDistortionDegree + 1> bernstein{};
  for (int i = 0; i <= n; ++i) {
    for (int j = 0; j <= i; ++j) {
      bernstein[static_cast<std::size_t>(i)] +=
          binomial(i, j) / binomial(n, j) * scaled[static_cast<std::size_t>(j)];
    }
  }
  return is_positive(bernstein, n, 40);
}

// Whether the distorted radius grows from the centre up to the squared radius `end`. Beyond a
// turning point the equation has solutions too, but they are not physical.
bool radius_grows_up_to(const std::array<double, 8>& k, double end) {
  const std::array<double, 4> numerator{1, k[0], k[1], k[4]};
  const std::array<double, 4> denominator{1, k[5], k[6], k[7]};
  const bool is_rational = k[5] != 0 || k[6] != 0 || k[7] != 0;
  // d/dr (r N / D) = ((N + 2 s N') D - 2 s N D') / D^2, s = r^2
  DistortionPolynomial slope;
  if (!is_rational) {
    slope.degree = 3;
    for (std::size_t i = 0; i < 4; ++i) slope.c[i] = static_cast<double>(2 * i + 1) * numerator[i];
    return is_positive_up_to(slope, end);
  }
  DistortionPolynomial pole;
  pole.degree = 3;
  std::copy(denominator.begin(), denominator.end(), pole.c.begin());
  slope.degree = 6;
  for (std::size_t i = 0; i < 4; ++i) {
    for (std::size_t j = 0; j < 4; ++j) {
      slope.c[i + j] += (1 + 2 * static_cast<double>(i) - 2 * static_cast<double>(j)) *
                        numerator[i] * denominator[j];
    }
  }
  return is_positive_up_to(pole, end) && is_positive_up_to(slope, end);
}

// For a fisheye: the distorted angle and its derivative.
struct DistortedAngle {
  double value;
  double slope;
};

DistortedAngle distort_angle(const std::array<double, 8>& k, double angle) {
  const double s = angle * angle;
  return {angle * (1 + s * (k[0] + s * (k[1] + s * (k[2] + s * k[3])))),
          1 + s * (3 * k[0] + s * (5 * k[1] + s * (7 * k[2] + s * 9 * k[3])))};
}

bool angle_grows_up_to(const std::array<double, 8>& k, double angle) {
  const DistortionPolynomial slope{{1, 3 * k[0], 5 * k[1], 7 * k[2], 9 * k[3], 0, 0}, 4};
  return is_positive_up_to(slope, angle * angle);
}

cv::Point2d distort_fisheye(const std::array<double, 8>& k, const cv::Point2d& p) {
  const double r = cv::norm(p);
  if (r < 1e-12) return p;
  return p * (distort_angle(k, std::atan(r)).value / r);
}

std::optional<cv::Point2d> undistort_fisheye(const std::array<double, 8>& k,
                                             const cv::Point2d& distorted) {
  const double target = cv::norm(distorted);
  if (target < 1e-12) return distorted;
  // The growing part is monotone: bisection keeps Newton's steps inside it.
  double low = 0;
  double high = CV_PI / 2;
  double angle = std::min(target, 0.9 * high);
  for (int iteration = 0; iteration < 200; ++iteration) {
    const DistortedAngle here = distort_angle(k, angle);
    const double error = here.value - target;
    if (std::abs(error) <= 4e-16 * (1 + target)) break;
    // Beyond the turning point the value falls: that is too far, too.
    (error > 0 || !angle_grows_up_to(k, angle) ? high : low) = angle;
    double next = angle - error / here.slope;
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    if (next == angle) break;
    angle = next;
  }
  const bool is_found = std::abs(distort_angle(k, angle).value - target) <= 1e-12 * (1 + target);
  if (!is_found || !angle_grows_up_to(k, angle) || angle >= CV_PI / 2 - 1e-9) return std::nullopt;
  return distorted * (std::tan(angle) / target);
}

}  // namespace

std::string_view name_of(Lens lens) { return kNames[static_cast<std::size_t>(lens)]; }

std::optional<Lens> lens_named(std::string_view name) {
  for (std::size_t i = 0; i < kNames.size(); ++i)
    if (kNames[i] == name) return static_cast<Lens>(i);
  return std::nullopt;
}

std::span<const double> Camera::coefficients() const {
  return {distortion.data(), kCoefficientCounts[static_cast<std::size_t>(lens)]};
}

void Camera::check() const {
  TARSIER_REQUIRE(width > 0 && height > 0, "size {}x{} px", width, height);
  TARSIER_REQUIRE(fx > 0 && fy > 0 && std::isfinite(fx) && std::isfinite(fy),
                  "focal lengths {}, {} px", fx, fy);
  TARSIER_REQUIRE(std::isfinite(cx) && std::isfinite(cy), "principal point ({}, {})", cx, cy);
  for (const double k : distortion) TARSIER_REQUIRE(std::isfinite(k), "distortion {}", k);
  for (std::size_t i = coefficients().size(); i < distortion.size(); ++i)
    TARSIER_REQUIRE(distortion[i] == 0, "number {} of a {} lens", i + 1, name_of(lens));
  TARSIER_REQUIRE(std::isfinite(rms), "rms {} px", rms);
}

cv::Point2d Camera::pixel_of(const cv::Point2d& normalized) const {
  cv::Point2d p = normalized;
  if (lens == Lens::kFisheye) {
    p = distort_fisheye(distortion, normalized);
  } else if (is_distorted()) {
    p = distort(distortion, normalized).point;
  }
  return {fx * p.x + cx, fy * p.y + cy};
}

std::optional<cv::Point2d> Camera::normalized_of(const cv::Point2d& pixel) const {
  const cv::Point2d distorted((pixel.x - cx) / fx, (pixel.y - cy) / fy);
  if (!std::isfinite(distorted.x) || !std::isfinite(distorted.y)) return std::nullopt;
  if (lens == Lens::kFisheye) return undistort_fisheye(distortion, distorted);
  if (!is_distorted()) return distorted;

  const double scale = 1 + cv::norm(distorted);
  cv::Point2d found = distorted;
  Distorted here = distort(distortion, found);
  double error = cv::norm(here.point - distorted);
  for (int iteration = 0; iteration < 100 && error > 4e-16 * scale; ++iteration) {
    const cv::Matx22d& d = here.derivative;
    const double determinant = d(0, 0) * d(1, 1) - d(0, 1) * d(1, 0);
    const cv::Point2d residual = here.point - distorted;
    cv::Point2d step((d(1, 1) * residual.x - d(0, 1) * residual.y) / determinant,
                     (d(0, 0) * residual.y - d(1, 0) * residual.x) / determinant);
    if (!std::isfinite(step.x) || !std::isfinite(step.y)) return std::nullopt;
    // Halves a step that increases the error.
    bool better = false;
    for (int halving = 0; halving < 30 && !better; ++halving) {
      const Distorted next = distort(distortion, found - step);
      const double next_error = cv::norm(next.point - distorted);
      better = next_error < error;
      if (better) {
        found -= step;
        here = next;
        error = next_error;
      }
      step *= 0.5;
    }
    if (!better) break;  // rounding, or no progress
  }
  const cv::Matx22d& d = here.derivative;
  const bool is_regular = d(0, 0) + d(1, 1) > 0 && d(0, 0) * d(1, 1) - d(0, 1) * d(1, 0) > 0;
  if (!(error <= 1e-12 * scale) || !is_regular || !radius_grows_up_to(distortion, found.dot(found)))
    return std::nullopt;
  return found;
}

std::optional<cv::Point2d> Camera::project(const Eigen::Vector3d& in_camera) const {
  if (!(in_camera[2] > 0)) return std::nullopt;
  return pixel_of({in_camera[0] / in_camera[2], in_camera[1] / in_camera[2]});
}

double Camera::largest_radius(double max_radius) const {
  TARSIER_REQUIRE(max_radius > 0 && std::isfinite(max_radius), "radius {}", max_radius);
  const auto grows = [&](double radius) {
    if (lens == Lens::kFisheye) return angle_grows_up_to(distortion, std::atan(radius));
    return !is_distorted() || radius_grows_up_to(distortion, radius * radius);
  };
  if (grows(max_radius)) return max_radius;
  double low = 0;
  double high = max_radius;
  for (int halving = 0; halving < 60; ++halving) {
    const double middle = 0.5 * (low + high);
    (grows(middle) ? low : high) = middle;
  }
  return low;
}

}  // namespace tarsier::geometry
