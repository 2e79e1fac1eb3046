// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/rigid3.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <optional>
#include <vector>

namespace tarsier::sfm {

// A camera (camera_from_world), and its observation of a point in normalised coordinates.
struct ObservationRay {
  geometry::Rigid3 pose;
  cv::Point2d ray;
};

// Triangulates a point from two or more rays: linear (Hartley and Zisserman, 12.2), then a few
// Gauss-Newton steps on the sum of squared distances in the normalised image planes. Empty where it
// is not determined, or not in front of every camera.
[[nodiscard]] std::optional<Eigen::Vector3d> triangulate(const std::vector<ObservationRay>& rays);

// Angle at `point` between the rays from two camera centres, radians.
[[nodiscard]] double ray_angle(const Eigen::Vector3d& point, const Eigen::Vector3d& center,
                               const Eigen::Vector3d& other);

}  // namespace tarsier::sfm
