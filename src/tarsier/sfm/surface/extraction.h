// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/surface/surface_mesh.h"
#include "tarsier/sfm/surface/voxel_volume.h"

#include <vector>

namespace tarsier::sfm {

// Extracts the surface of distance 0 by marching cubes (Lorensen and Cline, SIGGRAPH 1987), in all
// cells whose eight voxels were observed. Cells where the distance differs by more than `max_jump`
// voxels between adjacent voxels are skipped: there the band behind one surface meets the free
// space in front of another.
//
// No edge of the result has more than two faces, and the surface is closed where everything around
// was observed. On a cell side with four crossings, the corners inside are always cut off
// separately, so that neighbouring cells agree. No diagonal of a cell's polygons is in a side; such
// a triangulation exists for each of the 256 cases. Faces are in the order of blocks and voxels.
// The result does not depend on the number of threads.
[[nodiscard]] SurfaceMesh extract_surface(const VoxelVolume& volume, double max_jump);

// For each pattern of inside corners (bit x + 2y + 4z of the index): the cell edges whose crossings
// are the corners of its triangles, three per triangle. Edge 4a + i goes along axis a from the i-th
// corner (in order) that is low on that axis.
[[nodiscard]] const std::vector<std::vector<int>>& cell_triangles();

}  // namespace tarsier::sfm
