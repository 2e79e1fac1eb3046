// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"

#include <opencv2/core/types.hpp>

#include <optional>

namespace tarsier::geometry {

// The camera for images of this size. It is unchanged if the camera's size is not known (0);
// otherwise all lengths are scaled with the image. Empty if the aspect ratio differs by more than 1
// %, and no side is within a pixel (of the smaller size) of what the other side gives: then the
// image was cropped or belongs to another camera. Rounding changes a side by up to a pixel, which
// is more than 1 % of flat images.
[[nodiscard]] std::optional<Camera> scaled_camera(const Camera& camera, cv::Size image);

// A camera for images without any information: no distortion, principal point at the centre, focal
// length `focal` times the larger side (1: 53 degrees of view, between webcams and phones).
[[nodiscard]] Camera guessed_camera(cv::Size image, double focal = 1);

}  // namespace tarsier::geometry
