// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/media/frame.h"

namespace tarsier::geometry {

// Returns the camera `given`, scaled to the frame's size (geometry::scaled_camera). Throws
// InputError, which names the frame, if the aspect ratios differ.
[[nodiscard]] geometry::Camera camera_of_frame(const geometry::Camera& given, const Frame& frame);

}  // namespace tarsier::geometry
