// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/dense/patch_match.h"
#include "tarsier/sfm/dense/plane_field.h"

#include <vector>

namespace tarsier::sfm {

// A plane for each pixel of `camera`, the reference at some scale, row by row. It passes through
// the three known points of the Delaunay triangle that contains the pixel. Outside of all triangles
// it faces the camera at the depth of the nearest point. Without any known point, it is in the
// middle of the range (by inverse depth). Internal to this module.
[[nodiscard]] std::vector<Plane> known_planes(const MatchProblem& problem,
                                              const geometry::Camera& camera);

}  // namespace tarsier::sfm
