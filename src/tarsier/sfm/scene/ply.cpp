// SPDX-License-Identifier: MIT
#include "tarsier/sfm/scene/ply.h"

#include "tarsier/core/require.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/sfm/scene/little_endian.h"

#include <fmt/format.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>

namespace tarsier::sfm {
namespace {

constexpr std::string_view kStart = "ply\nformat binary_little_endian 1.0\ncomment Tarsier\n";
constexpr std::string_view kVertex =
    "property float x\nproperty float y\nproperty float z\n"
    "property uchar red\nproperty uchar green\nproperty uchar blue\n";

const cv::Vec3b kCenterColor(40, 40, 220);  // BGR: red, the image corners lighter
const cv::Vec3b kCornerColor(60, 160, 255);

void put_index(std::string& bytes, std::size_t index) {
  put(bytes, static_cast<std::uint32_t>(index));
}

void put_color(std::string& bytes, const cv::Vec3b& bgr) {
  for (int k = 2; k >= 0; --k) bytes.push_back(static_cast<char>(bgr[k]));
}

void put_vertex(std::string& bytes, const Eigen::Vector3d& position, const cv::Vec3b& bgr) {
  for (int k = 0; k < 3; ++k) {
    const auto value = static_cast<float>(position[k]);
    TARSIER_REQUIRE(std::isfinite(value), "position {}", position[k]);
    put(bytes, value);
  }
  put_color(bytes, bgr);
}

}  // namespace

void write_points_ply(const std::string& path, const Model& model) {
  std::string bytes =
      fmt::format("{}element vertex {}\n{}end_header\n", kStart, model.points.size(), kVertex);
  bytes.reserve(bytes.size() + model.points.size() * 15);
  for (const Point& point : model.points) put_vertex(bytes, point.position, point.color);
  write_file_atomically(path, bytes);
}

void write_cameras_ply(const std::string& path, const Model& model, double size) {
  TARSIER_REQUIRE(size > 0 && std::isfinite(size), "size {}", size);
  constexpr std::array<std::array<std::size_t, 2>, 8> kEdges{
      {{0, 1}, {0, 2}, {0, 3}, {0, 4}, {1, 2}, {2, 3}, {3, 4}, {4, 1}}};
  constexpr std::array<std::array<std::size_t, 3>, 6> kTriangles{
      {{0, 2, 1}, {0, 3, 2}, {0, 4, 3}, {0, 1, 4}, {1, 2, 3}, {1, 3, 4}}};
  std::string vertices;
  std::string faces;
  std::string edges;
  std::size_t count = 0;
  for (const Image& image : model.images) {
    if (!image.registered) continue;
    TARSIER_REQUIRE(
        image.camera >= 0 && static_cast<std::size_t>(image.camera) < model.cameras.size(),
        "camera {} of '{}'", image.camera, image.name);
    const geometry::Camera& camera = model.cameras[static_cast<std::size_t>(image.camera)];
    camera.check();
    // The image's border is half a pixel outside the centres of its outer pixels.
    const double left = (-0.5 - camera.cx) / camera.fx;
    const double right = (camera.width - 0.5 - camera.cx) / camera.fx;
    const double top = (-0.5 - camera.cy) / camera.fy;
    const double bottom = (camera.height - 0.5 - camera.cy) / camera.fy;
    const geometry::Rigid3 world_from_camera = image.pose.inverse();
    put_vertex(vertices, world_from_camera.translation, kCenterColor);
    for (const Eigen::Vector3d& corner :
         {Eigen::Vector3d(left, top, 1), Eigen::Vector3d(right, top, 1),
          Eigen::Vector3d(right, bottom, 1), Eigen::Vector3d(left, bottom, 1)}) {
      put_vertex(vertices, world_from_camera * (size * corner), kCornerColor);
    }
    const std::size_t first = 5 * count++;
    for (const auto& triangle : kTriangles) {
      faces.push_back(3);
      for (const std::size_t vertex : triangle) put_index(faces, first + vertex);
    }
    for (const auto& edge : kEdges) {
      for (const std::size_t vertex : edge) put_index(edges, first + vertex);
      put_color(edges, kCornerColor);
    }
  }
  write_file_atomically(
      path,
      fmt::format("{}element vertex {}\n{}element face {}\n"
                  "property list uchar int vertex_indices\n"
                  "element edge {}\nproperty int vertex1\nproperty int vertex2\n"
                  "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                  "end_header\n",
                  kStart, 5 * count, kVertex, kTriangles.size() * count, kEdges.size() * count) +
          vertices + faces + edges);
}

}  // namespace tarsier::sfm
