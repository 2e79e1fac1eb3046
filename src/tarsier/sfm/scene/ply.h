// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <string>

namespace tarsier::sfm {

// PLY files (binary, little endian) for MeshLab, CloudCompare, Blender and the like, in world units
// and with colours. Written atomically; throw OutputError, and std::invalid_argument for numbers
// that are not finite.

// The points: x y z (float), red green blue (uchar).
void write_points_ply(const std::string& path, const Model& model);

// A pyramid for each registered image, in their order: vertex 0 is the camera's centre, 1 to 4
// are the corners of its image (top left, top right, bottom right, bottom left) at depth `size`
// (world units, > 0) as a lens without distortion would see them; its edges; and six triangles
// that close it, seen from outside counter-clockwise.
void write_cameras_ply(const std::string& path, const Model& model, double size);

}  // namespace tarsier::sfm
