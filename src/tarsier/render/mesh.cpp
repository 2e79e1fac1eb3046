// SPDX-License-Identifier: MIT
#include "tarsier/render/mesh.h"

#include "tarsier/core/image.h"
#include "tarsier/core/require.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace tarsier::render {
namespace {

template <typename Vector>
bool is_finite(const Vector& value) {
  for (int k = 0; k < Vector::channels; ++k) {
    if (!std::isfinite(value[k])) return false;
  }
  return true;
}

template <typename Vector>
void check_finite(const std::vector<Vector>& values, const char* what) {
  for (std::size_t i = 0; i < values.size(); ++i) {
    TARSIER_REQUIRE(is_finite(values[i]), "{} {} of the mesh is not finite", what, i);
  }
}

void check_indices(const std::array<int, 3>& indices, std::size_t count, bool optional,
                   const char* what, std::size_t triangle) {
  const bool none = indices[0] == -1 && indices[1] == -1 && indices[2] == -1;
  if (optional && none) return;
  for (const int index : indices) {
    TARSIER_REQUIRE(index >= 0 && static_cast<std::size_t>(index) < count,
                    "triangle {} of the mesh has {} {} of {}", triangle, what, index, count);
  }
}

// Twice the area times the unit normal.
cv::Vec3f area_normal(const Mesh& mesh, const Triangle& triangle) {
  const cv::Vec3f& a = mesh.positions[static_cast<std::size_t>(triangle.position[0])];
  const cv::Vec3f& b = mesh.positions[static_cast<std::size_t>(triangle.position[1])];
  const cv::Vec3f& c = mesh.positions[static_cast<std::size_t>(triangle.position[2])];
  return (b - a).cross(c - a);
}

// The triangles around each position: those of position p are list[first[p] .. first[p + 1]).
struct Adjacency {
  std::vector<int> first;
  std::vector<int> list;
};

Adjacency triangles_around(const Mesh& mesh) {
  Adjacency adjacency;
  adjacency.first.assign(mesh.positions.size() + 1, 0);
  for (const Triangle& triangle : mesh.triangles) {
    for (const int p : triangle.position) ++adjacency.first[static_cast<std::size_t>(p) + 1];
  }
  for (std::size_t p = 1; p < adjacency.first.size(); ++p)
    adjacency.first[p] += adjacency.first[p - 1];
  adjacency.list.resize(static_cast<std::size_t>(adjacency.first.back()));
  std::vector<int> next(adjacency.first.begin(), adjacency.first.end() - 1);
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (const int p : mesh.triangles[t].position) {
      adjacency.list[static_cast<std::size_t>(next[static_cast<std::size_t>(p)]++)] =
          static_cast<int>(t);
    }
  }
  return adjacency;
}

}  // namespace

Texture make_texture(const cv::Mat& image) {
  require_bgr(image);
  Texture texture;
  texture.levels.push_back(image.clone());
  while (texture.levels.back().cols > 1 || texture.levels.back().rows > 1) {
    const cv::Mat& last = texture.levels.back();
    cv::Mat half;
    cv::resize(last, half, {std::max(1, last.cols / 2), std::max(1, last.rows / 2)}, 0, 0,
               cv::INTER_AREA);
    texture.levels.push_back(half);
  }
  return texture;
}

void Mesh::check() const {
  check_finite(positions, "position");
  check_finite(normals, "normal");
  check_finite(uvs, "texture coordinate");
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    check_indices(triangles[t].position, positions.size(), false, "position", t);
    check_indices(triangles[t].normal, normals.size(), true, "normal", t);
    check_indices(triangles[t].uv, uvs.size(), true, "texture coordinate", t);
    const int material = triangles[t].material;
    TARSIER_REQUIRE(material >= -1 && material < static_cast<int>(materials.size()),
                    "triangle {} of the mesh has material {} of {}", t, material, materials.size());
  }
  for (const Material& material : materials) {
    TARSIER_REQUIRE(is_finite(material.color), "the colour of material '{}' is not finite",
                    material.name);
    TARSIER_REQUIRE(material.texture >= -1 && material.texture < static_cast<int>(textures.size()),
                    "material '{}' has texture {} of {}", material.name, material.texture,
                    textures.size());
  }
  for (const Texture& texture : textures) {
    TARSIER_REQUIRE(!texture.levels.empty(), "a texture of the mesh has no image");
    for (const cv::Mat& level : texture.levels) require_bgr(level);
  }
}

Bounds bounds_of(const Mesh& mesh) {
  TARSIER_REQUIRE(!mesh.triangles.empty(), "a mesh without triangles has no bounds");
  Bounds bounds;
  bounds.low = bounds.high =
      mesh.positions[static_cast<std::size_t>(mesh.triangles.front().position[0])];
  for (const Triangle& triangle : mesh.triangles) {
    for (const int p : triangle.position) {
      const cv::Vec3f& x = mesh.positions[static_cast<std::size_t>(p)];
      for (int k = 0; k < 3; ++k) {
        bounds.low[k] = std::min(bounds.low[k], x[k]);
        bounds.high[k] = std::max(bounds.high[k], x[k]);
      }
    }
  }
  return bounds;
}

void add_normals(Mesh& mesh, double crease_deg) {
  TARSIER_REQUIRE(crease_deg >= 0 && crease_deg <= 180, "crease of {} degrees", crease_deg);
  const auto min_cosine = static_cast<float>(std::cos(crease_deg * CV_PI / 180) - 1e-6);
  std::vector<cv::Vec3f> faces(mesh.triangles.size());
  std::vector<float> areas(mesh.triangles.size());
  for (std::size_t t = 0; t < faces.size(); ++t) {
    const cv::Vec3f normal = area_normal(mesh, mesh.triangles[t]);
    areas[t] = static_cast<float>(cv::norm(normal));
    faces[t] = areas[t] > 0 ? normal / areas[t] : cv::Vec3f(0, 0, 0);
  }
  const Adjacency adjacency = triangles_around(mesh);
  // A vertex with very many triangles (the centre of a fan) would take quadratic time. Above this
  // number the triangle's own normal is used.
  constexpr int kMaxVertexTriangles = 256;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    Triangle& triangle = mesh.triangles[t];
    if (triangle.normal[0] >= 0 || !(areas[t] > 0)) continue;
    for (std::size_t corner = 0; corner < 3; ++corner) {
      const auto p = static_cast<std::size_t>(triangle.position[corner]);
      const int begin = adjacency.first[p];
      const int end = adjacency.first[p + 1];
      cv::Vec3f sum = faces[t] * areas[t];
      if (end - begin <= kMaxVertexTriangles) {
        sum = {0, 0, 0};
        for (int k = begin; k < end; ++k) {
          const auto other = static_cast<std::size_t>(adjacency.list[static_cast<std::size_t>(k)]);
          if (faces[other].dot(faces[t]) >= min_cosine) sum += faces[other] * areas[other];
        }
      }
      const auto length = static_cast<float>(cv::norm(sum));
      triangle.normal[corner] = static_cast<int>(mesh.normals.size());
      mesh.normals.push_back(length > 0 ? cv::Vec3f(sum / length) : faces[t]);
    }
  }
}

void append(Mesh& mesh, const Mesh& other) {
  const int positions = static_cast<int>(mesh.positions.size());
  const int normals = static_cast<int>(mesh.normals.size());
  const int uvs = static_cast<int>(mesh.uvs.size());
  const int materials = static_cast<int>(mesh.materials.size());
  const int textures = static_cast<int>(mesh.textures.size());
  mesh.positions.insert(mesh.positions.end(), other.positions.begin(), other.positions.end());
  mesh.normals.insert(mesh.normals.end(), other.normals.begin(), other.normals.end());
  mesh.uvs.insert(mesh.uvs.end(), other.uvs.begin(), other.uvs.end());
  mesh.textures.insert(mesh.textures.end(), other.textures.begin(), other.textures.end());
  for (Material material : other.materials) {
    if (material.texture >= 0) material.texture += textures;
    mesh.materials.push_back(std::move(material));
  }
  for (Triangle triangle : other.triangles) {
    for (std::size_t k = 0; k < 3; ++k) {
      triangle.position[k] += positions;
      if (triangle.normal[k] >= 0) triangle.normal[k] += normals;
      if (triangle.uv[k] >= 0) triangle.uv[k] += uvs;
    }
    if (triangle.material >= 0) triangle.material += materials;
    mesh.triangles.push_back(triangle);
  }
}

}  // namespace tarsier::render
