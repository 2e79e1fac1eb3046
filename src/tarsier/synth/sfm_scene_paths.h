// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/synth/sfm_scene.h"

#include <Eigen/Core>

#include <span>
#include <vector>

// The camera poses of sfm_scene.h. Internal to this module.
namespace tarsier::synth {

constexpr double kCameraDistance = 10;          // units, from the cameras to the centre of view
const Eigen::Vector3d kSceneCenter{0, 0, 0.8};  // centre of view of arc and ring
constexpr double kRingDeg = 42;                 // elevation of a ring above the ground

// Around the centre, along a line, or over a grid. With pure_rotation, the camera is in front of
// the centre.
[[nodiscard]] geometry::Rigid3 make_pose(Trajectory trajectory, bool pure_rotation, double ring_deg,
                                         int index, int count, const Rng& base);

// `count` cameras along a line on the ground, at the eye height of a tall person, looking ahead and
// to the left. They are closer together where the line bends.
[[nodiscard]] std::vector<geometry::Rigid3> poses_along(std::span<const Eigen::Vector2d> line,
                                                        int count, const Rng& base);

}  // namespace tarsier::synth
