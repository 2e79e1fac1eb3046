// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/surface_mesh.h"

#include "tarsier/core/at.h"
#include "tarsier/core/require.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numeric>

namespace tarsier::sfm {
namespace {

int next(int corner) { return corner == 2 ? 0 : corner + 1; }

// An edge of a face, for sorting by vertices.
struct Side {
  std::uint64_t key = 0;     // the smaller and the larger vertex
  std::uint32_t corner = 0;  // 3 * face + index of the edge
};

std::vector<Side> sorted_sides(const SurfaceMesh& mesh) {
  std::vector<Side> sides;
  sides.reserve(3 * mesh.faces.size());
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const auto a = static_cast<std::uint32_t>(mesh.faces[f][at(k)]);
      const auto b = static_cast<std::uint32_t>(mesh.faces[f][at(next(k))]);
      sides.push_back({(std::uint64_t{std::min(a, b)} << 32) | std::max(a, b),
                       static_cast<std::uint32_t>(3 * f + at(k))});
    }
  }
  std::sort(sides.begin(), sides.end(), [](const Side& a, const Side& b) {
    return a.key != b.key ? a.key < b.key : a.corner < b.corner;
  });
  return sides;
}

// Disjoint sets, represented by their smallest members.
class Sets {
 public:
  explicit Sets(std::size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), 0);
  }
  int find(int i) {
    while (parent_[at(i)] != i) i = parent_[at(i)] = parent_[at(parent_[at(i)])];
    return i;
  }
  void join(int a, int b) {
    a = find(a);
    b = find(b);
    if (a != b) parent_[at(std::max(a, b))] = std::min(a, b);
  }

 private:
  std::vector<int> parent_;
};

Sets parts_of(const std::vector<Face>& neighbors) {
  Sets parts(neighbors.size());
  for (std::size_t f = 0; f < neighbors.size(); ++f) {
    for (const int other : neighbors[f])
      if (other >= 0) parts.join(static_cast<int>(f), other);
  }
  return parts;
}

BoundaryLoop loop_of(std::vector<int> vertices, const SurfaceMesh& mesh) {
  BoundaryLoop loop;
  Eigen::Vector3d low(1e300, 1e300, 1e300);
  Eigen::Vector3d high = -low;
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    const Eigen::Vector3d here = mesh.vertices[at(vertices[i])].cast<double>();
    const Eigen::Vector3d there =
        mesh.vertices[at(vertices[(i + 1) % vertices.size()])].cast<double>();
    loop.length += (there - here).norm();
    loop.center += here / static_cast<double>(vertices.size());
    low = low.cwiseMin(here);
    high = high.cwiseMax(here);
  }
  loop.diameter = (high - low).norm();
  loop.vertices = std::move(vertices);
  return loop;
}

}  // namespace

void SurfaceMesh::check() const {
  for (std::size_t i = 0; i < vertices.size(); ++i)
    TARSIER_REQUIRE(vertices[i].allFinite(), "vertex {} is not finite", i);
  TARSIER_REQUIRE(colors.empty() || colors.size() == vertices.size(), "{} colours for {} vertices",
                  colors.size(), vertices.size());
  const int count = static_cast<int>(vertices.size());
  for (std::size_t f = 0; f < faces.size(); ++f) {
    for (const int v : faces[f])
      TARSIER_REQUIRE(v >= 0 && v < count, "vertex {} of face {} does not exist", v, f);
    TARSIER_REQUIRE(
        faces[f][0] != faces[f][1] && faces[f][1] != faces[f][2] && faces[f][2] != faces[f][0],
        "face {} uses a vertex twice", f);
  }
}

std::vector<Face> face_neighbors(const SurfaceMesh& mesh) {
  std::vector<Face> neighbors(mesh.faces.size(), Face{-1, -1, -1});
  const std::vector<Side> sides = sorted_sides(mesh);
  for (std::size_t begin = 0; begin < sides.size();) {
    std::size_t end = begin + 1;
    while (end < sides.size() && sides[end].key == sides[begin].key) ++end;
    if (end - begin == 2) {
      const std::uint32_t a = sides[begin].corner;
      const std::uint32_t b = sides[begin + 1].corner;
      neighbors[a / 3][a % 3] = static_cast<int>(b / 3);
      neighbors[b / 3][b % 3] = static_cast<int>(a / 3);
    }
    begin = end;
  }
  return neighbors;
}

std::vector<Eigen::Vector3f> vertex_normals(const SurfaceMesh& mesh) {
  std::vector<Eigen::Vector3f> normals(mesh.vertices.size(), Eigen::Vector3f::Zero());
  for (const Face& face : mesh.faces) {
    const Eigen::Vector3f& a = mesh.vertices[at(face[0])];
    const Eigen::Vector3f normal =
        (mesh.vertices[at(face[1])] - a).cross(mesh.vertices[at(face[2])] - a);
    for (const int v : face) normals[at(v)] += normal;
  }
  for (Eigen::Vector3f& normal : normals) {
    const float length = normal.norm();
    if (length > 0) normal /= length;
  }
  return normals;
}

std::vector<BoundaryLoop> boundary_loops(const SurfaceMesh& mesh) {
  const std::vector<Face> neighbors = face_neighbors(mesh);
  std::vector<int> to(mesh.vertices.size(), -1);
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) {
    for (int k = 0; k < 3; ++k)
      if (neighbors[f][at(k)] < 0) to[at(mesh.faces[f][at(k)])] = mesh.faces[f][at(next(k))];
  }
  std::vector<BoundaryLoop> loops;
  std::vector<char> seen(to.size(), 0);
  for (std::size_t start = 0; start < to.size(); ++start) {
    std::vector<int> chain;
    int v = static_cast<int>(start);
    while (v >= 0 && seen[at(v)] == 0 && to[at(v)] >= 0) {
      seen[at(v)] = 1;
      chain.push_back(v);
      v = to[at(v)];
    }
    if (chain.size() >= 3 && v == static_cast<int>(start))
      loops.push_back(loop_of(std::move(chain), mesh));
  }
  std::stable_sort(loops.begin(), loops.end(), [](const BoundaryLoop& a, const BoundaryLoop& b) {
    return a.length > b.length;
  });
  return loops;
}

int split_touching_vertices(SurfaceMesh& mesh) {
  const std::vector<Face> neighbors = face_neighbors(mesh);
  // Corners of faces that share a vertex and an edge belong to one fan.
  Sets fans(3 * mesh.faces.size());
  const auto corner_of = [&](int face, int vertex) {
    for (int k = 0; k < 3; ++k)
      if (mesh.faces[at(face)][at(k)] == vertex) return 3 * face + k;
    return -1;
  };
  for (std::size_t f = 0; f < neighbors.size(); ++f) {
    for (int k = 0; k < 3; ++k) {
      const int other = neighbors[f][at(k)];
      if (other < static_cast<int>(f)) continue;
      for (const int end : {k, next(k)})
        fans.join(3 * static_cast<int>(f) + end, corner_of(other, mesh.faces[f][at(end)]));
    }
  }
  std::vector<int> fan_of(mesh.vertices.size(), -1);
  std::vector<int> own(3 * mesh.faces.size(), -1);  // for each fan
  int added = 0;
  for (std::size_t c = 0; c < own.size(); ++c) {
    int& vertex = mesh.faces[c / 3][c % 3];
    const int fan = fans.find(static_cast<int>(c));
    int& copy = own[at(fan)];
    if (copy < 0) {
      if (fan_of[at(vertex)] < 0) {
        fan_of[at(vertex)] = fan;
        copy = vertex;
      } else {
        copy = static_cast<int>(mesh.vertices.size());
        const Eigen::Vector3f position = mesh.vertices[at(vertex)];
        mesh.vertices.push_back(position);
        if (!mesh.colors.empty()) {
          const cv::Vec3b color = mesh.colors[at(vertex)];
          mesh.colors.push_back(color);
        }
        ++added;
      }
    }
    vertex = copy;
  }
  return added;
}

int remove_small_parts(SurfaceMesh& mesh, double share) {
  TARSIER_REQUIRE(share >= 0 && share <= 1, "{}", share);
  Sets parts = parts_of(face_neighbors(mesh));
  std::vector<std::size_t> sizes(mesh.faces.size(), 0);
  for (std::size_t f = 0; f < mesh.faces.size(); ++f) ++sizes[at(parts.find(static_cast<int>(f)))];
  const std::size_t largest = sizes.empty() ? 0 : *std::max_element(sizes.begin(), sizes.end());
  const auto is_small = [&](std::size_t size) {
    return static_cast<double>(size) < share * static_cast<double>(largest);
  };
  std::vector<Face> remaining_faces;
  for (std::size_t f = 0; f < mesh.faces.size(); ++f)
    if (!is_small(sizes[at(parts.find(static_cast<int>(f)))]))
      remaining_faces.push_back(mesh.faces[f]);
  mesh.faces = std::move(remaining_faces);
  remove_unused_vertices(mesh);
  return static_cast<int>(std::count_if(
      sizes.begin(), sizes.end(), [&](std::size_t size) { return size > 0 && is_small(size); }));
}

void remove_unused_vertices(SurfaceMesh& mesh) {
  std::vector<int> to(mesh.vertices.size(), -1);
  for (const Face& face : mesh.faces)
    for (const int v : face) to[at(v)] = 0;
  int count = 0;
  for (std::size_t v = 0; v < to.size(); ++v) {
    if (to[v] < 0) continue;
    to[v] = count++;
    mesh.vertices[at(to[v])] = mesh.vertices[v];
    if (!mesh.colors.empty()) mesh.colors[at(to[v])] = mesh.colors[v];
  }
  mesh.vertices.resize(at(count));
  if (!mesh.colors.empty()) mesh.colors.resize(at(count));
  for (Face& face : mesh.faces)
    for (int& v : face) v = to[at(v)];
}

SurfaceMeasures measure_surface(const SurfaceMesh& mesh) {
  SurfaceMeasures result;
  std::vector<char> used(mesh.vertices.size(), 0);
  for (const Face& face : mesh.faces)
    for (const int v : face) used[at(v)] = 1;
  bool is_first = true;
  for (std::size_t v = 0; v < used.size(); ++v) {
    if (used[v] == 0) continue;
    ++result.vertices;
    const Eigen::Vector3d x = mesh.vertices[v].cast<double>();
    result.low = is_first ? x : Eigen::Vector3d(result.low.cwiseMin(x));
    result.high = is_first ? x : Eigen::Vector3d(result.high.cwiseMax(x));
    is_first = false;
  }
  result.faces = static_cast<std::int64_t>(mesh.faces.size());
  const std::vector<Side> sides = sorted_sides(mesh);
  bool is_manifold = true;
  for (std::size_t begin = 0; begin < sides.size();) {
    std::size_t end = begin + 1;
    while (end < sides.size() && sides[end].key == sides[begin].key) ++end;
    ++result.edges;
    is_manifold = is_manifold && end - begin <= 2;
    begin = end;
  }
  Sets parts = parts_of(face_neighbors(mesh));
  for (std::size_t f = 0; f < mesh.faces.size(); ++f)
    if (parts.find(static_cast<int>(f)) == static_cast<int>(f)) ++result.parts;
  for (const BoundaryLoop& loop : boundary_loops(mesh)) {
    ++result.holes;
    result.hole_length += loop.length;
  }
  const Eigen::Vector3d center = 0.5 * (result.low + result.high);
  double volume = 0;
  for (const Face& face : mesh.faces) {
    const Eigen::Vector3d a = mesh.vertices[at(face[0])].cast<double>() - center;
    const Eigen::Vector3d b = mesh.vertices[at(face[1])].cast<double>() - center;
    const Eigen::Vector3d c = mesh.vertices[at(face[2])].cast<double>() - center;
    result.area += 0.5 * (b - a).cross(c - a).norm();
    volume += a.dot(b.cross(c)) / 6;
  }
  if (result.is_closed() && is_manifold) result.volume = volume;
  return result;
}

nlohmann::ordered_json to_json(const SurfaceMeasures& measures) {
  const Eigen::Vector3d extent = measures.high - measures.low;
  nlohmann::ordered_json json{{"vertices", measures.vertices},
                              {"faces", measures.faces},
                              {"parts", measures.parts},
                              {"euler", measures.euler()},
                              {"closed", measures.volume.has_value()},
                              {"holes", measures.holes},
                              {"hole_length", measures.hole_length},
                              {"area", measures.area}};
  json["volume"] = measures.volume ? nlohmann::ordered_json(*measures.volume) : nullptr;
  json["extent"] = {extent[0], extent[1], extent[2]};
  return json;
}

}  // namespace tarsier::sfm
