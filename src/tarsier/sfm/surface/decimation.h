// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/surface/surface_mesh.h"

#include <stop_token>

namespace tarsier::sfm {

// Collapses edges until at most `faces` are left, or none can be collapsed. The first edge is the
// one whose new vertex is nearest to the planes of the faces it represents, by the sum of squared
// distances weighted by area (Garland and Heckbert, "Surface simplification using quadric error
// metrics", SIGGRAPH 1997). Planes through the boundary, perpendicular to its faces, preserve it.
// An edge is kept where its collapse would change the topology (link condition: Dey, Edelsbrunner,
// Guha and Nekhayev 1999) or rotate a face by more than 78 degrees. Equal costs are ordered by
// vertex, so that the result is deterministic. Drops colours. Throws Interrupted.
void decimate(SurfaceMesh& mesh, int faces, const std::stop_token& stop);

}  // namespace tarsier::sfm
