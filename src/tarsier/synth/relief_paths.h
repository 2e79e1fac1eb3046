// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/synth/relief.h"

#include <Eigen/Core>

#include <span>
#include <vector>

// Where the cameras of relief.h stand. Internal to this module.
namespace tarsier::synth {

constexpr double kCameraDistance = 10;          // units, of the cameras from what they look at
const Eigen::Vector3d kSceneMiddle{0, 0, 0.8};  // what arc and ring look at
constexpr double kRingDeg = 42;                 // of a ring, above the ground

// Around the middle, along a line, or over a grid. A camera that only turns stands before the middle.
[[nodiscard]] geometry::Rigid3 make_pose(Trajectory trajectory, bool pure_rotation, double ring_deg,
                                         int index, int count, const Rng& base);

// `count` cameras along a line on the ground, at the height of a tall person's eyes, which look ahead and to the left. Where
// the line turns, they are closer to each other.
[[nodiscard]] std::vector<geometry::Rigid3> poses_along(std::span<const Eigen::Vector2d> line,
                                                        int count, const Rng& base);

}  // namespace tarsier::synth
