// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"

#include <opencv2/core/types.hpp>

#include <optional>

namespace tarsier::geometry {

// The camera of images of this size: the same, where the camera's size is not known (0); with all
// lengths in proportion, where the image was made larger or smaller. Empty where the sides'
// proportion is another (by more than 1 %): then part of the image was cut off, or it is another
// camera's.
[[nodiscard]] std::optional<Camera> scaled_camera(const Camera& camera, cv::Size image);

// Where nothing is known: no distortion, the middle in the middle, a focal length of `focal` times
// the larger side (1: 53 degrees of view, between webcams and telephones).
[[nodiscard]] Camera guessed_camera(cv::Size image, double focal = 1);

}  // namespace tarsier::geometry
