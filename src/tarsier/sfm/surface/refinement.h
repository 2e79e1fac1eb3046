// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/surface/surface_mesh.h"

namespace tarsier::sfm {

// Closes boundary loops whose bounding box has a diagonal of at most `diameter` (world units). Adds
// rings of vertices towards the centre, then moves each new vertex to the mean of its neighbours,
// so that the patch is a membrane. Requires split_touching_vertices(). New vertices have the mean
// colour of the loop. Returns the number of closed loops.
int close_holes(SurfaceMesh& mesh, double diameter);

// Moves each vertex towards the mean of its neighbours (by 0.5 of the distance) and back (by
// -0.53). This removes noise and preserves the volume (Taubin, "A signal processing approach to
// fair surface design", SIGGRAPH 1995). Boundary vertices only move along the boundary. Does not
// depend on the number of threads.
void smooth_surface(SurfaceMesh& mesh, int iterations);

}  // namespace tarsier::sfm
