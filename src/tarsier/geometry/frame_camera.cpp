// SPDX-License-Identifier: MIT
#include "tarsier/geometry/frame_camera.h"

#include "tarsier/core/errors.h"
#include "tarsier/geometry/scaled_camera.h"

#include <fmt/format.h>

namespace tarsier::geometry {

geometry::Camera camera_of_frame(const geometry::Camera& given, const Frame& frame) {
  const auto camera = geometry::scaled_camera(given, frame.image.size());
  if (!camera) {
    throw InputError(frame.name,
                     fmt::format("is {} x {} px, the camera's images are {} x {}", frame.image.cols,
                                 frame.image.rows, given.width, given.height));
  }
  return *camera;
}

}  // namespace tarsier::geometry
