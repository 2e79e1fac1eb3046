// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/media/frame.h"

namespace tarsier::geometry {

// The camera of this frame: `given`, scaled to its size (geometry::scaled_camera). Throws
// InputError, naming the frame, where the sides' proportion is another.
[[nodiscard]] geometry::Camera camera_of_frame(const geometry::Camera& given, const Frame& frame);

}  // namespace tarsier::geometry
