// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/render/mesh.h"
#include "tarsier/sfm/surface/surface_mesh.h"
#include "tarsier/sfm/surface/texture.h"

#include <Eigen/Core>

#include <optional>
#include <string>
#include <vector>

namespace tarsier::sfm {

struct TexturedSurface {
  SurfaceMesh mesh;
  std::optional<SurfaceTexture> texture;
};

enum class SurfaceFormat { kPly, kObj, kGlb };
// The format of an extension: .ply, .obj, .glb. Throws UsageError for any other.
[[nodiscard]] SurfaceFormat surface_format_of(const std::string& path);
// The files that write_surface() writes, the main one last.
[[nodiscard]] std::vector<std::string> surface_files(const std::string& path, bool textured);

// Writes a surface in world units. Each file is written completely or not at all, the main one
// last.
// - .ply: binary, little endian: x y z nx ny nz, and red green blue where there are colours. A
//   texture is in NAME.png and `texcoord` of each face, as in MeshLab.
// - .obj: text with v (followed by the colours, where there is no texture), vn, vt; NAME.mtl,
//   NAME.png. read_obj() of render/obj_io.h reads it.
// - .glb: binary glTF 2.0 (https://registry.khronos.org/glTF/specs/2.0/glTF-2.0.html) in one file,
//   with the texture as JPEG of quality 95 or with colours. It is unlit (KHR_materials_unlit), as
//   the images contain the light. Its frame has y up: the rotation `upright` transforms the world
//   to it, as the matrix of the node.
//
// Throws OutputError, UsageError (extension), std::invalid_argument (SurfaceMesh::check()).
void write_surface(const std::string& path, const TexturedSurface& surface,
                   const Eigen::Matrix3d& upright = Eigen::Matrix3d::Identity());

// Reads a surface without its texture: .ply (binary little endian; x y z and faces first, colours
// where red, green and blue exist; polygons become fans) or .obj (read_obj() of render/obj_io.h).
// Faces that use a vertex twice are left out. Throws InputError: a missing file, no faces, an index
// out of range, numbers that are not finite, more than 20 million vertices or faces.
[[nodiscard]] SurfaceMesh read_surface(const std::string& path);

// For render(): with the texture, or each face in the mean colour of its corners, or grey.
[[nodiscard]] render::Mesh render_mesh(const TexturedSurface& surface);

}  // namespace tarsier::sfm
