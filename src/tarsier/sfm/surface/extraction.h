// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/surface/surface_mesh.h"
#include "tarsier/sfm/surface/voxel_volume.h"

#include <vector>

namespace tarsier::sfm {

// The surface of distance 0, by marching cubes (Lorensen and Cline, SIGGRAPH 1987), in all cells
// whose eight voxels were seen. In a cell where the distance jumps by more than `max_jump` voxels
// from one voxel to the next there is none: there the band behind one surface meets the free space
// before another.
//
// The result has no edge of more than two faces, and a closed one where all around was seen: on a
// cell's side with four crossings the corners inside are always cut off one by one, so that
// neighbours agree, and no diagonal of a cell's polygons lies in a side (there is a triangulation
// without for each of the 256 cases). Faces in the order of blocks and voxels, the same for any
// number of threads.
[[nodiscard]] SurfaceMesh extract_surface(const VoxelVolume& volume, double max_jump);

// The edges of a cell whose crossings are the corners of its triangles, three each, for every
// pattern of corners inside (bit x + 2y + 4z of the index). Edge 4a + i goes along axis a from the
// i-th corner (in order) that is low on it.
[[nodiscard]] const std::vector<std::vector<int>>& cell_triangles();

}  // namespace tarsier::sfm
