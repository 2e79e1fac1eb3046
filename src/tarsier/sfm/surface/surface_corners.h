// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/surface/surface_files.h"

#include <cstdint>
#include <vector>

namespace tarsier::sfm {

// A surface as graphics processors take it: one vertex for each pair of position and place in the
// texture.
struct SurfaceCorners {
  std::vector<int> vertex;             // of the surface
  std::vector<int> uv;                 // of the texture, as many; empty: no texture
  std::vector<std::uint32_t> indices;  // of the two above, three a face
};
[[nodiscard]] SurfaceCorners corners_of(const TexturedSurface& surface);

}  // namespace tarsier::sfm
