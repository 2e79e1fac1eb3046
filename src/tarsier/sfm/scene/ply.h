// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <string>

namespace tarsier::sfm {

// PLY files (binary, little endian) for MeshLab, CloudCompare, Blender and similar programs, in
// world units and with colours. Files are written atomically. Both functions throw OutputError, and
// std::invalid_argument for numbers that are not finite. Coordinates are float, or double where the
// origin is so far away that float would distort the scene (is_beyond_float()).

// The points: x y z (float or double), red green blue (uchar).
void write_points_ply(const std::string& path, const Model& model);

// Writes a pyramid for each registered image, in their order. Vertex 0 is the camera centre.
// Vertices 1 to 4 are the image corners (top left, top right, bottom right, bottom left) at depth
// `size` (world units, > 0), as seen by a lens without distortion. Edges and six triangles close
// the pyramid; the triangles are counter-clockwise when seen from outside.
void write_cameras_ply(const std::string& path, const Model& model, double size);

}  // namespace tarsier::sfm
