// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <opencv2/core/matx.hpp>

#include <array>
#include <cstddef>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <vector>

// Triangle meshes with shared vertices, and their measures.
namespace tarsier::sfm {

using Face = std::array<int, 3>;  // indices of vertices, counter-clockwise as seen from outside

struct SurfaceMesh {
  std::vector<Eigen::Vector3f> vertices;  // world units
  std::vector<cv::Vec3b> colors;          // BGR, for each vertex; or empty
  std::vector<Face> faces;

  // Throws std::invalid_argument, which names the first fault: an index out of range, a face that
  // uses a vertex twice, a number that is not finite, different numbers of colours and vertices.
  void check() const;
};

// For each face the neighbours across the edges (0, 1), (1, 2) and (2, 0); -1: a boundary edge, or
// one with more than two faces.
[[nodiscard]] std::vector<Face> face_neighbors(const SurfaceMesh& mesh);

// For each vertex, of length 1: mean of the adjacent faces, weighted by area; 0 where there is
// none.
[[nodiscard]] std::vector<Eigen::Vector3f> vertex_normals(const SurfaceMesh& mesh);

// A closed chain of edges with a face on one side only.
struct BoundaryLoop {
  std::vector<int> vertices;  // in the direction of the faces' edges: the surface is to the left
  double length = 0;          // world units
  double diameter = 0;        // world units, diagonal of the bounding box
  Eigen::Vector3d center = Eigen::Vector3d::Zero();  // mean of the vertices
};
// Longest first. Requires split_touching_vertices(), so that no vertex is on two loops.
[[nodiscard]] std::vector<BoundaryLoop> boundary_loops(const SurfaceMesh& mesh);

// Splits vertices where several fans of faces touch in one point only. The surface is then a
// 2-manifold with boundary, except for edges of more than two faces. Returns the number of added
// vertices.
int split_touching_vertices(SurfaceMesh& mesh);

// Removes edge-connected parts with fewer faces than `share` (0..1) of the largest part, then
// unused vertices. Returns the number of removed parts.
int remove_small_parts(SurfaceMesh& mesh, double share);

// Keeps the order of the remaining vertices.
void remove_unused_vertices(SurfaceMesh& mesh);

struct SurfaceMeasures {
  std::int64_t vertices = 0;
  std::int64_t edges = 0;
  std::int64_t faces = 0;
  int parts = 0;           // connected by edges
  int holes = 0;           // boundary loops
  double hole_length = 0;  // world units, of all holes
  double area = 0;         // square world units
  // Cubic world units, by the divergence theorem: sum of a . (b x c) / 6; only for a closed
  // surface.
  std::optional<double> volume;
  Eigen::Vector3d low = Eigen::Vector3d::Zero();  // world units, bounding box
  Eigen::Vector3d high = Eigen::Vector3d::Zero();

  [[nodiscard]] std::int64_t euler() const { return vertices - edges + faces; }
  [[nodiscard]] bool is_closed() const { return faces > 0 && holes == 0; }
  [[nodiscard]] double diagonal() const { return (high - low).norm(); }
};
[[nodiscard]] SurfaceMeasures measure_surface(const SurfaceMesh& mesh);
// {"vertices", "faces", "parts", "euler", "closed", "holes", "hole_length", "area", "volume" (null
// where open), "extent": [x, y, z]}
[[nodiscard]] nlohmann::ordered_json to_json(const SurfaceMeasures& measures);

}  // namespace tarsier::sfm
