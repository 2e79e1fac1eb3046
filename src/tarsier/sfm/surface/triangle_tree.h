// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/surface/surface_mesh.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <vector>

namespace tarsier::sfm {

// Distance of `from` to the triangle a, b, c, which may be a line or a point: of the perpendicular
// foot where it is inside, else of the nearest of the three sides (Eberly, "Distance between point
// and triangle in 3D", 1999).
[[nodiscard]] float triangle_distance(const Eigen::Vector3f& from, const Eigen::Vector3f& a,
                                      const Eigen::Vector3f& b, const Eigen::Vector3f& c);

// The faces of a surface in a tree of boxes, halved at the median of the longest side, to look for
// the nearest one. Const after construction; may be asked by several threads.
class TriangleTree {
 public:
  explicit TriangleTree(SurfaceMesh mesh);  // throws std::invalid_argument (SurfaceMesh::check())

  // Distance of the nearest face, or `limit` where none is nearer.
  [[nodiscard]] float distance(const Eigen::Vector3f& from, float limit) const;

 private:
  struct Node {
    Eigen::AlignedBox3f box;
    int left = -1;  // of an inner node; the right one follows behind all of the left
    int right = -1;
    int begin = 0;  // of a leaf: its faces
    int end = 0;
  };
  [[nodiscard]] const Eigen::Vector3f& corner(int face, int k) const;
  int build(int begin, int end, const std::vector<Eigen::Vector3f>& middles);

  SurfaceMesh mesh_;
  std::vector<int> order_;  // of the faces, as the leaves have them
  std::vector<Node> nodes_;
};

}  // namespace tarsier::sfm
