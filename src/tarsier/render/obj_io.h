// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/render/mesh.h"

#include <cstdint>
#include <string>
#include <vector>

// Wavefront OBJ with its material library.
namespace tarsier::render {

struct ObjLimits {
  std::int64_t max_bytes = 64'000'000;           // of the OBJ file; of the MTL file 1/64 of it
  int max_faces = 5'000'000;                     // triangles; the lists of vertices may be as long
  std::int64_t max_texture_pixels = 16'000'000;  // of each texture
  int max_textures = 32;
};

struct ObjFile {
  Mesh mesh;
  std::vector<std::string> notes;  // what was left out: a texture or library that is missing
};

// v x y z, vt u v, vn x y z, f with v, v/vt, v//vn or v/vt/vn, counted from 1 or, negative, back
// from the last; polygons become fans; usemtl, mtllib with newmtl, Kd and map_Kd (without options);
// groups, objects and smoothing groups are read over, as are lines and other elements. Faces
// without normals get them (add_normals). mtllib and map_Kd name files of the OBJ's own folder or
// below it.
// Throws InputError, naming file and line: not such a file, numbers that are not finite or beyond
// 1e9, indices out of range, no faces, beyond the limits, a file outside the folder, a broken
// texture.
[[nodiscard]] ObjFile read_obj(const std::string& path, const ObjLimits& limits = {});

}  // namespace tarsier::render
