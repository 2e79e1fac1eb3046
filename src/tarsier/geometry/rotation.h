// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/rigid.h"

#include <opencv2/core.hpp>

// More on rotation matrices.
namespace tarsier::geometry {

// Rodrigues' vector of a rotation: its axis, as long as its angle in radians, 0..pi.
[[nodiscard]] cv::Vec3d rotation_vector(const cv::Matx33d& rotation);

// From rotation a (part 0) towards b (part 1) along the shorter way, at even speed.
[[nodiscard]] cv::Matx33d interpolate(const cv::Matx33d& a, const cv::Matx33d& b, double part);

}  // namespace tarsier::geometry
