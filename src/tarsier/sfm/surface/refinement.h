// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/surface/surface_mesh.h"

namespace tarsier::sfm {

// Closes the loops of the boundary whose box has a diagonal of at most `diameter` (world units): rings of vertices
// towards the middle, then each of the new vertices in the mean of its neighbours, so that the cap
// is a membrane. Expects split_touching_vertices(). Colours of new vertices are the mean of the
// loop's. Returns how many were closed.
int close_holes(SurfaceMesh& mesh, double diameter);

// Moves each vertex towards the mean of its neighbours (0.5 of the way) and back (-0.53): noise
// goes, and the volume stays (Taubin, "A signal processing approach to fair surface design",
// SIGGRAPH 1995). Vertices of the boundary move along it only. The same for any number of threads.
void smooth_surface(SurfaceMesh& mesh, int iterations);

}  // namespace tarsier::sfm
