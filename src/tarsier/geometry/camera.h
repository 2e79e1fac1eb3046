// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core.hpp>

#include <array>
#include <optional>

// The camera model of the whole library: a pinhole with OpenCV's five distortion numbers.
// Pixel centres are at integers: the middle of the top left pixel is (0, 0).
namespace tarsier::geometry {

struct Camera {
  int width = 0;  // px
  int height = 0;
  double fx = 0;  // px
  double fy = 0;
  double cx = 0;  // px, of the middle of the top left pixel: 0
  double cy = 0;
  std::array<double, 5> distortion{};  // k1 k2 p1 p2 k3
  double rms = 0;                      // px, of its calibration; 0: not known

  [[nodiscard]] cv::Matx33d matrix() const { return {fx, 0, cx, 0, fy, cy, 0, 0, 1}; }
  [[nodiscard]] bool is_distorted() const {
    for (const double k : distortion)
      if (k != 0) return true;
    return false;
  }

  // Throws std::invalid_argument unless sizes and focal lengths are positive and all is finite.
  void check() const;

  // From normalised coordinates (x/z, y/z) in the camera's frame (x right, y down, z forward) to
  // px: x' = x (1 + k1 r2 + k2 r4 + k3 r6) + 2 p1 x y + p2 (r2 + 2 x2), y' alike; u = fx x' + cx.
  [[nodiscard]] cv::Point2d pixel_of(const cv::Point2d& normalized) const;

  // The inverse, by Newton's method from the undistorted point; exact to 1e-10 where the model can
  // be inverted. Empty where it cannot (a strong distortion far outside the picture).
  [[nodiscard]] std::optional<cv::Point2d> normalized_of(const cv::Point2d& pixel) const;

  // Pixel of a point in the camera's frame; empty behind it (z <= 0).
  [[nodiscard]] std::optional<cv::Point2d> project(const cv::Vec3d& in_camera) const;
};

}  // namespace tarsier::geometry
