// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"

#include <opencv2/core.hpp>

#include <cstdint>
#include <optional>
#include <vector>

namespace tarsier::sfm {

// The pose of a camera (camera_from_world) from points of the world and their undistorted pixels,
// some of which are wrong: OpenCV's USAC with local optimisation. `max_error_px`: max reprojection
// error of an inlier. Empty where no pose is found. Deterministic by the seed.
[[nodiscard]] std::optional<geometry::Rigid3> absolute_pose(
    const std::vector<cv::Point3d>& positions, const std::vector<cv::Point2d>& pixels,
    const geometry::Camera& camera, double max_error_px, std::uint64_t seed);

}  // namespace tarsier::sfm
