// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/render/mesh.h"

#include <cstdint>
#include <string>
#include <vector>

// Wavefront OBJ with its material library.
namespace tarsier::render {

struct ObjLimits {
  std::int64_t max_bytes = 64'000'000;  // of the OBJ file; the MTL file may have 1/64 of it
  int max_faces = 5'000'000;            // triangles; also the limit of the vertex lists
  std::int64_t max_texture_pixels = 16'000'000;  // of each texture
  int max_textures = 32;
};

struct ObjFile {
  Mesh mesh;
  std::vector<std::string> notes;  // skipped items: a missing texture or library
};

// Supported elements: v x y z, vt u v, vn x y z, f with v, v/vt, v//vn or v/vt/vn (indices from 1,
// or negative from the end), usemtl, mtllib with newmtl, Kd and map_Kd (without options). Polygons
// become fans. Groups, objects, smoothing groups, lines and other elements are ignored. Faces
// without normals get them (add_normals). mtllib and map_Kd name files in the OBJ's own folder or
// below it.
// Throws InputError, which names the file and line: another format, numbers that are not finite or
// beyond 1e9, indices out of range, no faces, exceeded limits, a file outside the folder, a broken
// texture.
[[nodiscard]] ObjFile read_obj(const std::string& path, const ObjLimits& limits = {});

}  // namespace tarsier::render
