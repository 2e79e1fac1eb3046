// SPDX-License-Identifier: MIT
#include "tarsier/geometry/scaled_camera.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <cmath>

namespace tarsier::geometry {

std::optional<Camera> scaled_camera(const Camera& camera, cv::Size image) {
  TARSIER_REQUIRE(image.width > 0 && image.height > 0, "an image of {}x{}", image.width,
                  image.height);
  Camera scaled = camera;
  scaled.width = image.width;
  scaled.height = image.height;
  if (camera.width <= 0 || camera.height <= 0) return scaled;
  const double x = static_cast<double>(image.width) / camera.width;
  const double y = static_cast<double>(image.height) / camera.height;
  const double difference_px = std::min(std::abs(camera.width * y - image.width),
                                        std::abs(camera.height * x - image.height));
  if (std::abs(x / y - 1) > 0.01 && difference_px > std::max({1.0, x, y})) return std::nullopt;
  // Pixel centres are at integers, pixel edges half a pixel away.
  scaled.fx *= x;
  scaled.fy *= y;
  scaled.cx = (camera.cx + 0.5) * x - 0.5;
  scaled.cy = (camera.cy + 0.5) * y - 0.5;
  return scaled;
}

Camera guessed_camera(cv::Size image, double focal) {
  TARSIER_REQUIRE(image.width > 0 && image.height > 0, "an image of {}x{}", image.width,
                  image.height);
  TARSIER_REQUIRE(focal > 0 && std::isfinite(focal), "focal {}", focal);
  Camera camera;
  camera.width = image.width;
  camera.height = image.height;
  camera.fx = camera.fy = focal * std::max(image.width, image.height);
  camera.cx = (image.width - 1) / 2.0;
  camera.cy = (image.height - 1) / 2.0;
  return camera;
}

}  // namespace tarsier::geometry
