// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <array>
#include <cstddef>
#include <optional>
#include <span>
#include <string_view>

// The camera model of the whole library: a perspective matrix behind one of OpenCV's three lenses.
// Pixel centres are at integers: the middle of the top left pixel is (0, 0).
namespace tarsier::geometry {

enum class Lens {
  kPinhole,   // Brown's radial and tangential distortion: k1 k2 p1 p2 k3
  kRational,  // the same over a second polynomial: k1 k2 p1 p2 k3 k4 k5 k6
  kFisheye    // Kannala and Brandt, PAMI 2006, as cv::fisheye has it: k1 k2 k3 k4
};

// "pinhole", "rational", "fisheye", and back (empty for any other name).
[[nodiscard]] std::string_view name_of(Lens lens);
[[nodiscard]] std::optional<Lens> lens_named(std::string_view name);

struct Camera {
  int width = 0;  // px
  int height = 0;
  double fx = 0;  // px
  double fy = 0;
  double cx = 0;  // px, of the middle of the top left pixel: 0
  double cy = 0;
  std::array<double, 8> distortion{};  // in the order of `lens`; the rest is 0
  double rms = 0;                      // px, of its calibration; 0: not known
  Lens lens = Lens::kPinhole;

  [[nodiscard]] cv::Matx33d matrix() const { return {fx, 0, cx, 0, fy, cy, 0, 0, 1}; }

  // The numbers that the lens has: 5, 8 or 4.
  [[nodiscard]] std::span<const double> coefficients() const;

  // A fisheye always is: even with four zeros it is no perspective.
  [[nodiscard]] bool is_distorted() const {
    if (lens == Lens::kFisheye) return true;
    for (const double k : distortion)
      if (k != 0) return true;
    return false;
  }

  // Throws std::invalid_argument unless sizes and focal lengths are positive, all is finite and
  // numbers that the lens does not have are 0.
  void check() const;

  // From normalised coordinates (x/z, y/z) in the camera's frame (x right, y down, z forward) to
  // px: u = fx x' + cx, v = fy y' + cy. With r2 = x2 + y2,
  // pinhole:  x' = x (1 + k1 r2 + k2 r4 + k3 r6) + 2 p1 x y + p2 (r2 + 2 x2), y' alike;
  // rational: the bracket divided by (1 + k4 r2 + k5 r4 + k6 r6);
  // fisheye:  x' = x t / r, t = a (1 + k1 a2 + k2 a4 + k3 a6 + k4 a8), a = atan(r).
  [[nodiscard]] cv::Point2d pixel_of(const cv::Point2d& normalized) const;

  // The inverse, by Newton's method from the undistorted point; exact to 1e-10 where the model can
  // be inverted. Empty where it cannot (a strong distortion far outside the image; 90 degrees
  // and more off the axis of a fisheye).
  [[nodiscard]] std::optional<cv::Point2d> normalized_of(const cv::Point2d& pixel) const;

  // Pixel of a point in the camera's frame; empty behind it (z <= 0).
  [[nodiscard]] std::optional<cv::Point2d> project(const Eigen::Vector3d& in_camera) const;

  // The normalised radius up to which the radial part grows, so that it can be inverted; `most`
  // (> 0) where it grows that far. Behind it the equation folds the image back.
  [[nodiscard]] double largest_radius(double most) const;
};

}  // namespace tarsier::geometry
