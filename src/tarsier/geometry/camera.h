// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string_view>

// The camera model of the whole library: a perspective projection with one of OpenCV's three lens
// models. Pixel centres are at integers: the centre of the top left pixel is (0, 0).
namespace tarsier::geometry {

enum class Lens {
  kPinhole,   // Brown's radial and tangential distortion: k1 k2 p1 p2 k3
  kRational,  // the same, divided by a second polynomial: k1 k2 p1 p2 k3 k4 k5 k6
  kFisheye    // Kannala and Brandt, PAMI 2006, as in cv::fisheye: k1 k2 k3 k4
};

// "pinhole", "rational", "fisheye", and back (empty for any other name).
[[nodiscard]] std::string_view name_of(Lens lens);
[[nodiscard]] std::optional<Lens> lens_named(std::string_view name);

struct Camera {
  int width = 0;  // px
  int height = 0;
  double fx = 0;  // px
  double fy = 0;
  double cx = 0;  // px; 0 is the centre of the top left pixel
  double cy = 0;
  std::array<double, 8> distortion{};  // coefficients in the order of `lens`; the rest is 0
  double rms = 0;                      // px, of the calibration; 0: not known
  Lens lens = Lens::kPinhole;

  [[nodiscard]] cv::Matx33d matrix() const { return {fx, 0, cx, 0, fy, cy, 0, 0, 1}; }

  // The coefficients of the lens: 5, 8 or 4 numbers.
  [[nodiscard]] std::span<const double> coefficients() const;

  // A fisheye is always distorted: even with four zeros it is not a perspective.
  [[nodiscard]] bool is_distorted() const {
    if (lens == Lens::kFisheye) return true;
    for (const double k : distortion)
      if (k != 0) return true;
    return false;
  }

  // Throws std::invalid_argument unless the size and the focal lengths are positive, all values are
  // finite and the unused coefficients are 0.
  void check() const;

  // Maps normalised coordinates (x/z, y/z) in the camera's frame (x right, y down, z forward) to
  // px: u = fx x' + cx, v = fy y' + cy. With r2 = x2 + y2,
  //   pinhole:  x' = x (1 + k1 r2 + k2 r4 + k3 r6) + 2 p1 x y + p2 (r2 + 2 x2), y' likewise;
  //   rational: the bracket divided by (1 + k4 r2 + k5 r4 + k6 r6);
  //   fisheye:  x' = x t / r, t = a (1 + k1 a2 + k2 a4 + k3 a6 + k4 a8), a = atan(r).
  [[nodiscard]] cv::Point2d pixel_of(const cv::Point2d& normalized) const;

  // The inverse, by Newton's method from the undistorted point; exact to 1e-10 where the model is
  // invertible. Empty where it is not: under a strong distortion far outside the image, or 90
  // degrees and more off the axis of a fisheye.
  [[nodiscard]] std::optional<cv::Point2d> normalized_of(const cv::Point2d& pixel) const;

  // Projects a point in the camera's frame; empty if it is behind the camera (z <= 0).
  [[nodiscard]] std::optional<cv::Point2d> project(const Eigen::Vector3d& in_camera) const;

  // The normalised radius up to which the radial part increases and is therefore invertible, at
  // most `max_radius` (> 0). Beyond it the model folds the image back.
  [[nodiscard]] double largest_radius(double max_radius) const;
};

}  // namespace tarsier::geometry
