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

// Surfaces of triangles that share their vertices, and what can be measured on them.
namespace tarsier::sfm {

using Face = std::array<int, 3>;  // indices of vertices, counter-clockwise as seen from outside

struct SurfaceMesh {
  std::vector<Eigen::Vector3f> vertices;  // world units
  std::vector<cv::Vec3b> colors;          // BGR, of each vertex; or empty
  std::vector<Face> faces;

  // Throws std::invalid_argument that names the first fault: an index out of range, a face that uses
  // a vertex twice, a number that is not finite, another number of colours than of vertices.
  void check() const;
};

// Of each face the neighbours across the edges (0, 1), (1, 2) and (2, 0); -1: an edge of the
// surface, or one that more than two faces share.
[[nodiscard]] std::vector<Face> face_neighbors(const SurfaceMesh& mesh);

// Of each vertex, of length 1: mean of the faces around it, weighted by area; 0 where there is none.
[[nodiscard]] std::vector<Eigen::Vector3f> vertex_normals(const SurfaceMesh& mesh);

// A closed chain of edges that have a face on one side only.
struct BoundaryLoop {
  std::vector<int> vertices;  // in the order of the faces' edges: the surface is to the left
  double length = 0;          // world units
  double diameter = 0;        // world units, diagonal of the box around it
  Eigen::Vector3d center = Eigen::Vector3d::Zero();  // mean of the vertices
};
// Longest first. Expects split_touching_vertices(): then no vertex is on two loops.
[[nodiscard]] std::vector<BoundaryLoop> boundary_loops(const SurfaceMesh& mesh);

// Gives each fan of faces a vertex of its own where several touch in one point only, so that the
// surface is a 2-manifold with boundary (edges of more than two faces excepted). Returns how many
// vertices were added.
int split_touching_vertices(SurfaceMesh& mesh);

// Removes what hangs together by edges and has fewer faces than `share` (0..1) of the largest part
// has, then unused vertices. Returns how many parts went.
int remove_small_parts(SurfaceMesh& mesh, double share);

// Keeps the order of the others.
void remove_unused_vertices(SurfaceMesh& mesh);

struct SurfaceMeasures {
  std::int64_t vertices = 0;
  std::int64_t edges = 0;
  std::int64_t faces = 0;
  int parts = 0;           // that hang together by edges
  int holes = 0;           // loops of the boundary
  double hole_length = 0;  // world units, of all of them
  double area = 0;         // square world units
  // Cubic world units, by the divergence theorem: sum of a . (b x c) / 6; only of a closed surface.
  std::optional<double> volume;
  Eigen::Vector3d low = Eigen::Vector3d::Zero();  // world units, of the box around it
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
