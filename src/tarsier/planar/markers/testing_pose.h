// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/planar/markers/pose.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

namespace tarsier::planar::markers {

// The marker's z axis points to the camera.
inline const Eigen::Matrix3d kFacing = Eigen::Vector3d(1, -1, -1).asDiagonal();

inline double degrees_between(const geometry::Rigid3& a, const geometry::Rigid3& b) {
  return geometry::angle_of(a.rotation * b.rotation.transpose()) * 180 / CV_PI;
}

inline geometry::Camera test_camera() {
  geometry::Camera camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 600;
  camera.cx = 319.5;
  camera.cy = 239.5;
  return camera;
}

inline Quad seen(const geometry::Rigid3& pose, double size, const geometry::Camera& camera) {
  Quad quad;
  const auto corners = corners_on_marker(size);
  for (std::size_t k = 0; k < 4; ++k) {
    const auto p = camera.project(pose * Eigen::Vector3d(corners[k].x, corners[k].y, 0)).value();
    quad[k] = {p.x, p.y};
  }
  return quad;
}

}  // namespace tarsier::planar::markers
