// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"

#include <opencv2/core.hpp>

namespace tarsier::geometry {

// A pinhole without distortion, of the same size, whose whole image lies inside that of `camera`:
// no empty borders. The outer pixel middles of its image are the largest upright rectangle
// between the four bent borders of `camera`'s (what cv::getOptimalNewCameraMatrix does for alpha
// 0, but with up to 1000 places on each side instead of 9), so fx, fy, cx and cy all change. Of a
// fisheye, whose border no plane may reach, it takes what lies within tan = 1.8 (61 degrees) of the
// axis, with equal focal lengths. A camera that has no distortion comes back as it is. Throws
// std::invalid_argument for no camera and Error (kBadInput) where the distortion cannot be undone
// everywhere in the image, or where nothing remains between the borders.
[[nodiscard]] Camera undistorted_camera(const Camera& camera);

// The image that `to` would have taken in the place of `from`: 8 or 16 bit, any channels,
// bicubic; outside of the source its border goes on. Throws std::invalid_argument unless `image`
// has the size of `from`, `to` has no distortion, and no side has more than 32766 px.
[[nodiscard]] cv::Mat undistort_image(const cv::Mat& image, const Camera& from, const Camera& to);

// The same for many images of one camera: where each pixel comes from is computed once.
class Straightener {
 public:
  // Throws as undistort_image().
  Straightener(const Camera& from, const Camera& to);
  [[nodiscard]] cv::Mat operator()(const cv::Mat& image) const;

 private:
  cv::Size from_;
  bool is_same_ = false;
  cv::Mat map_;
  cv::Mat fractions_;
};

inline constexpr int kMaxUndistortedSide = 32'766;  // px, of cv::remap

}  // namespace tarsier::geometry
