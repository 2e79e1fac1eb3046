// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/surface_page.h"

#include "tarsier/media/image_file.h"
#include "tarsier/sfm/dense/cloud.h"
#include "tarsier/sfm/surface/surface_corners.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <system_error>
#include <vector>

namespace tarsier::sfm {

ViewerCloud viewer_cloud(const std::string& path, double scale) {
  constexpr std::size_t kMaxPoints = 1'000'000;
  ViewerCloud result;
  std::error_code ignored;
  if (!std::filesystem::exists(path, ignored)) return result;
  const std::vector<CloudPoint> points = read_cloud(path);
  const std::size_t step = points.size() / kMaxPoints + 1;
  for (std::size_t i = 0; i < points.size(); i += step) {
    const cv::Vec3f& at = points[i].position;
    result.positions.emplace_back(Eigen::Vector3f(at[0], at[1], at[2]) * static_cast<float>(scale));
    result.colors.push_back(points[i].color);
  }
  return result;
}

ViewerSurface viewer_surface(const TexturedSurface& surface) {
  constexpr int kQuality = 90;
  const SurfaceCorners corners = corners_of(surface);
  ViewerSurface result;
  result.indices = corners.indices;
  for (std::size_t i = 0; i < corners.vertex.size(); ++i) {
    const auto vertex = static_cast<std::size_t>(corners.vertex[i]);
    result.vertices.push_back(surface.mesh.vertices[vertex]);
    result.colors.push_back(surface.mesh.colors.empty() ? cv::Vec3b(150, 150, 150)
                                                        : surface.mesh.colors[vertex]);
    if (!surface.texture) continue;
    const cv::Vec2f& uv = surface.texture->uvs[static_cast<std::size_t>(corners.uv[i])];
    result.uvs.emplace_back(uv[0], 1 - uv[1]);  // counted from the top
  }
  if (surface.texture && !corners.indices.empty()) {
    const std::vector<std::uint8_t> jpeg =
        encode_image(".jpg", surface.texture->image, "the page's texture", kQuality);
    result.texture.assign(jpeg.begin(), jpeg.end());
  }
  return result;
}

}  // namespace tarsier::sfm
