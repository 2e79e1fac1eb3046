// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/dense/patch_match.h"
#include "tarsier/sfm/dense/plane_field.h"

#include <vector>

namespace tarsier::sfm {

// A plane for each pixel of `camera`, the reference at some scale: through the three known points of
// the Delaunay triangle that the pixel lies in; outside of all triangles, facing the camera at the
// depth of the nearest point; in the middle of the range (by inverse depth) where no point is known.
// Row by row. Internal to this module.
[[nodiscard]] std::vector<Plane> known_planes(const MatchProblem& problem,
                                              const geometry::Camera& camera);

}  // namespace tarsier::sfm
