// SPDX-License-Identifier: MIT
#include "tarsier/geometry/scaled_camera.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <cmath>

namespace tarsier::geometry {

std::optional<Camera> scaled_camera(const Camera& camera, cv::Size picture) {
  TARSIER_REQUIRE(picture.width > 0 && picture.height > 0, "a picture of {}x{}", picture.width,
                  picture.height);
  Camera scaled = camera;
  scaled.width = picture.width;
  scaled.height = picture.height;
  if (camera.width <= 0 || camera.height <= 0) return scaled;
  const double x = static_cast<double>(picture.width) / camera.width;
  const double y = static_cast<double>(picture.height) / camera.height;
  if (std::abs(x / y - 1) > 0.01) return std::nullopt;
  // The middles of pixels are at integers, their edges half a pixel off.
  scaled.fx *= x;
  scaled.fy *= y;
  scaled.cx = (camera.cx + 0.5) * x - 0.5;
  scaled.cy = (camera.cy + 0.5) * y - 0.5;
  return scaled;
}

Camera guessed_camera(cv::Size picture, double focal) {
  TARSIER_REQUIRE(picture.width > 0 && picture.height > 0, "a picture of {}x{}", picture.width,
                  picture.height);
  TARSIER_REQUIRE(focal > 0 && std::isfinite(focal), "focal {}", focal);
  Camera camera;
  camera.width = picture.width;
  camera.height = picture.height;
  camera.fx = camera.fy = focal * std::max(picture.width, picture.height);
  camera.cx = (picture.width - 1) / 2.0;
  camera.cy = (picture.height - 1) / 2.0;
  return camera;
}

}  // namespace tarsier::geometry
