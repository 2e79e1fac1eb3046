// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/surface_corners.h"

#include <cstddef>

namespace tarsier::sfm {

SurfaceCorners corners_of(const TexturedSurface& surface) {
  const auto at = [](int index) { return static_cast<std::size_t>(index); };
  SurfaceCorners result;
  if (!surface.texture) {
    for (int v = 0; v < static_cast<int>(surface.mesh.vertices.size()); ++v)
      result.vertex.push_back(v);
    for (const Face& face : surface.mesh.faces)
      for (const int v : face) result.indices.push_back(static_cast<std::uint32_t>(v));
    return result;
  }
  // A texture coordinate belongs to one vertex: that of the first face that uses it.
  std::vector<int> index_of(surface.texture->uvs.size(), -1);
  for (std::size_t f = 0; f < surface.mesh.faces.size(); ++f) {
    for (std::size_t k = 0; k < 3; ++k) {
      const int uv = surface.texture->corners[f][k];
      if (index_of[at(uv)] < 0) {
        index_of[at(uv)] = static_cast<int>(result.vertex.size());
        result.vertex.push_back(surface.mesh.faces[f][k]);
        result.uv.push_back(uv);
      }
      result.indices.push_back(static_cast<std::uint32_t>(index_of[at(uv)]));
    }
  }
  return result;
}

}  // namespace tarsier::sfm
