// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/surface/surface_mesh.h"

#include <stop_token>

namespace tarsier::sfm {

// Collapses edges until at most `faces` are left, or none can be collapsed: the one first whose new
// vertex is nearest to the planes of the faces that it stands for, by the sum of squared distances
// weighted by area (Garland and Heckbert, "Surface simplification using quadric error metrics",
// SIGGRAPH 1997). Planes through the boundary, upright on their face, keep it in place. An edge
// stays where the collapse would change the topology (link condition: Dey, Edelsbrunner, Guha and
// Nekhayev 1999) or turn a face by more than 78 degrees. Equal costs in the order of the vertices:
// the same mesh gives the same. Drops colours. Throws Interrupted.
void decimate(SurfaceMesh& mesh, int faces, const std::stop_token& stop);

}  // namespace tarsier::sfm
