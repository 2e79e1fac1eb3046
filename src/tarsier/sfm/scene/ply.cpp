// SPDX-License-Identifier: MIT
#include "tarsier/sfm/scene/ply.h"

#include "tarsier/core/require.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/sfm/scene/align.h"
#include "tarsier/sfm/scene/little_endian.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

constexpr std::string_view kStart = "ply\nformat binary_little_endian 1.0\ncomment Tarsier\n";

const cv::Vec3b kCenterColor(40, 40, 220);  // BGR: red, the image corners lighter
const cv::Vec3b kCornerColor(60, 160, 255);

void put_index(std::string& bytes, std::size_t index) {
  put(bytes, static_cast<std::uint32_t>(index));
}

void put_color(std::string& bytes, const cv::Vec3b& bgr) {
  for (int k = 2; k >= 0; --k) bytes.push_back(static_cast<char>(bgr[k]));
}

double median_of(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// Writes vertices whose coordinates are float or, where the scene needs it, double.
class VertexWriter {
 public:
  // `positions` of the scene; a few far ones do not count.
  explicit VertexWriter(std::vector<Eigen::Vector3d> positions) {
    std::erase_if(positions, [](const Eigen::Vector3d& one) { return !one.allFinite(); });
    if (positions.empty()) return;
    Eigen::Vector3d center;
    std::vector<double> values(positions.size());
    for (int k = 0; k < 3; ++k) {
      for (std::size_t p = 0; p < positions.size(); ++p) values[p] = positions[p][k];
      center[k] = median_of(values);
    }
    for (std::size_t p = 0; p < positions.size(); ++p) values[p] = (positions[p] - center).norm();
    const double radius = median_of(values);
    is_double_ = radius > 0 && is_beyond_float(center, radius);
  }
  [[nodiscard]] std::string properties() const {
    const std::string_view type = is_double_ ? "double" : "float";
    return fmt::format(
        "property {0} x\nproperty {0} y\nproperty {0} z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\n",
        type);
  }
  void put_vertex(std::string& bytes, const Eigen::Vector3d& position, const cv::Vec3b& bgr) const {
    for (int k = 0; k < 3; ++k) {
      const auto value = static_cast<float>(position[k]);
      TARSIER_REQUIRE(std::isfinite(value), "position {}", position[k]);
      if (is_double_)
        put(bytes, position[k]);
      else
        put(bytes, value);
    }
    put_color(bytes, bgr);
  }

 private:
  bool is_double_ = false;
};

}  // namespace

void write_points_ply(const std::string& path, const Model& model) {
  std::vector<Eigen::Vector3d> positions;
  positions.reserve(model.points.size());
  for (const Point& point : model.points) positions.push_back(point.position);
  const VertexWriter writer(std::move(positions));
  std::string bytes = fmt::format("{}element vertex {}\n{}end_header\n", kStart,
                                  model.points.size(), writer.properties());
  bytes.reserve(bytes.size() + model.points.size() * 27);
  for (const Point& point : model.points) writer.put_vertex(bytes, point.position, point.color);
  write_file_atomically(path, bytes);
}

void write_cameras_ply(const std::string& path, const Model& model, double size) {
  TARSIER_REQUIRE(size > 0 && std::isfinite(size), "size {}", size);
  constexpr std::array<std::array<std::size_t, 2>, 8> kEdges{
      {{0, 1}, {0, 2}, {0, 3}, {0, 4}, {1, 2}, {2, 3}, {3, 4}, {4, 1}}};
  constexpr std::array<std::array<std::size_t, 3>, 6> kTriangles{
      {{0, 2, 1}, {0, 3, 2}, {0, 4, 3}, {0, 1, 4}, {1, 2, 3}, {1, 3, 4}}};
  std::vector<Eigen::Vector3d> centers;
  for (const Image& image : model.images)
    if (image.registered) centers.push_back(image.pose.center());
  const VertexWriter writer(std::move(centers));
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
    writer.put_vertex(vertices, world_from_camera.translation, kCenterColor);
    for (const Eigen::Vector3d& corner :
         {Eigen::Vector3d(left, top, 1), Eigen::Vector3d(right, top, 1),
          Eigen::Vector3d(right, bottom, 1), Eigen::Vector3d(left, bottom, 1)}) {
      writer.put_vertex(vertices, world_from_camera * (size * corner), kCornerColor);
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
      path, fmt::format("{}element vertex {}\n{}element face {}\n"
                        "property list uchar int vertex_indices\n"
                        "element edge {}\nproperty int vertex1\nproperty int vertex2\n"
                        "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                        "end_header\n",
                        kStart, 5 * count, writer.properties(), kTriangles.size() * count,
                        kEdges.size() * count) +
                vertices + faces + edges);
}

}  // namespace tarsier::sfm
