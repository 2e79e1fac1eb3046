// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/rigid.h"

#include <opencv2/core.hpp>

#include <optional>
#include <vector>

namespace tarsier::sfm {

// A camera (camera_from_world) and where it sees a point, in normalised coordinates.
struct ObservationRay {
  geometry::Rigid pose;
  cv::Point2d ray;
};

// The point that two or more rays have in common: linear (Hartley and Zisserman, 12.2), then some
// Gauss-Newton steps on the sum of squared distances in the normalised image planes. Empty where it
// is not determined, or not in front of every camera.
[[nodiscard]] std::optional<cv::Vec3d> triangulate(const std::vector<ObservationRay>& rays);

// Angle at `point` between the rays from two centres, radians.
[[nodiscard]] double ray_angle(const cv::Vec3d& point, const cv::Vec3d& center,
                               const cv::Vec3d& other);

}  // namespace tarsier::sfm
