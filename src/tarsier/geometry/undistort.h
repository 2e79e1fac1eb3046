// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"

#include <opencv2/core.hpp>

namespace tarsier::geometry {

// A pinhole camera without distortion, of the same size, whose whole image lies inside that of
// `camera`: there are no empty borders. The outermost pixel centres of its image form the largest
// upright rectangle between the four curved borders of `camera`'s image. This is what
// cv::getOptimalNewCameraMatrix does for alpha 0, but with up to 1000 points on each side instead
// of 9. So fx, fy, cx and cy all change.
// The border of a fisheye image may not be reachable by a plane. Its new image is limited to tan =
// 1.8 (61 degrees) from the axis, with equal focal lengths. A camera without distortion is returned
// unchanged. Throws std::invalid_argument for an invalid camera, and Error (kInput) if the
// distortion is not invertible everywhere in the image or if nothing remains between the borders.
[[nodiscard]] Camera undistorted_camera(const Camera& camera);

// The image that `to` would have taken in place of `from`: 8 or 16 bit, any channels, bicubic.
// Outside the source the border pixels are repeated. Throws std::invalid_argument unless `image`
// has the size of `from`, `to` has no distortion, and no side has more than 32766 px.
[[nodiscard]] cv::Mat undistort_image(const cv::Mat& image, const Camera& from, const Camera& to);

// The same for many images of one camera: the map is computed once.
class Undistorter {
 public:
  // Throws the same exceptions as undistort_image().
  Undistorter(const Camera& from, const Camera& to);
  [[nodiscard]] cv::Mat operator()(const cv::Mat& image) const;

 private:
  cv::Size from_;
  bool is_same_ = false;
  cv::Mat map_;
  cv::Mat fractions_;
};

inline constexpr int kMaxUndistortedSide = 32'766;  // px, limit of cv::remap

}  // namespace tarsier::geometry
