// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/surface/surface_files.h"

#include <cstdint>
#include <vector>

namespace tarsier::sfm {

// A surface in the form that GPUs need: one vertex per pair of position and texture coordinate.
struct SurfaceCorners {
  std::vector<int> vertex;  // indices of the surface's vertices
  std::vector<int> uv;      // indices of texture coordinates, equally many; empty: no texture
  std::vector<std::uint32_t> indices;  // of the two above, three per face
};
[[nodiscard]] SurfaceCorners corners_of(const TexturedSurface& surface);

}  // namespace tarsier::sfm
