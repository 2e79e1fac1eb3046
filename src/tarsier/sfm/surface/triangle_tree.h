// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/surface/surface_mesh.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <vector>

namespace tarsier::sfm {

// Distance of `from` to the triangle a, b, c, which may be degenerate: to the perpendicular foot
// where it is inside, else to the nearest of the three sides (Eberly, "Distance between point and
// triangle in 3D", 1999).
[[nodiscard]] float triangle_distance(const Eigen::Vector3f& from, const Eigen::Vector3f& a,
                                      const Eigen::Vector3f& b, const Eigen::Vector3f& c);

// A bounding volume hierarchy of the faces of a surface, for nearest neighbour search. Boxes are
// split at the median of their longest side. Const after construction, for use by several threads.
class TriangleTree {
 public:
  explicit TriangleTree(SurfaceMesh mesh);  // throws std::invalid_argument (SurfaceMesh::check())

  // Distance of the nearest face, at most `limit`.
  [[nodiscard]] float distance(const Eigen::Vector3f& from, float limit) const;

 private:
  struct Node {
    Eigen::AlignedBox3f box;
    int left = -1;  // of an inner node; the right child follows after all of the left subtree
    int right = -1;
    int begin = 0;  // of a leaf: range of its faces
    int end = 0;
  };
  [[nodiscard]] const Eigen::Vector3f& corner(int face, int k) const;
  int build(int begin, int end, const std::vector<Eigen::Vector3f>& centroids);

  SurfaceMesh mesh_;
  std::vector<int> order_;  // faces in the order of the leaves
  std::vector<Node> nodes_;
};

}  // namespace tarsier::sfm
