// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/synth/height_field.h"
#include "tarsier/synth/relief.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <span>
#include <stop_token>

// What relief.h draws, and its surface in triangles. Internal to this module.
namespace tarsier::synth {

// Stands on z = 0, turned about z.
struct Box {
  double x = 0;
  double y = 0;
  double half[2] = {};
  double top = 0;
  double cosine = 1;
  double sine = 0;
  cv::Vec3f tint;

  [[nodiscard]] Eigen::Vector3d to_own(const Eigen::Vector3d& v) const {
    return {cosine * v[0] + sine * v[1], -sine * v[0] + cosine * v[1], v[2]};
  }
  [[nodiscard]] Eigen::Vector3d from_own(const Eigen::Vector3d& v) const {
    return {cosine * v[0] - sine * v[1], sine * v[0] + cosine * v[1], v[2]};
  }
  // Strictly inside.
  [[nodiscard]] bool contains(const Eigen::Vector3d& at) const {
    const Eigen::Vector3d own = to_own(at - Eigen::Vector3d(x, y, 0));
    return std::abs(own[0]) < half[0] && std::abs(own[1]) < half[1] && own[2] < top;
  }
};

// The field over `region` (x, y) and the boxes above it, as ReliefScene::surface() has them.
// Throws Interrupted.
[[nodiscard]] SceneSurface triangulate(const HeightField& field, std::span<const Box> boxes,
                                       const geometry::Camera& camera,
                                       std::span<const geometry::Rigid3> poses, cv::Rect2d region,
                                       double step, const std::stop_token& stop);

}  // namespace tarsier::synth
