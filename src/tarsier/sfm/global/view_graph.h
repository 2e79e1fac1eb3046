// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <vector>

// The view graph. Images are nodes. Verified pairs are edges, with the rotation between the two
// cameras.
namespace tarsier::sfm {

struct RelativeRotation {
  int first = 0;
  int second = 0;
  Eigen::Matrix3d second_from_first = Eigen::Matrix3d::Identity();
  double weight = 1;  // > 0, number of verified matches
};

// Connected components by union-find.
class Components {
 public:
  explicit Components(std::size_t count);
  int root(int node);
  // Returns false where both were connected already.
  bool join(int a, int b);

 private:
  std::vector<int> parents_;
};

// For an edge: the number of 3-cycles that contain it, and how many of them have rotations that
// compose to the identity.
struct CycleSupport {
  int cycles = 0;
  int closed = 0;
};

// Checks each triangle of the graph. A cycle is closed if the product of its three rotations has an
// angle of at most `max_deg` (Zach, Klopschitz and Pollefeys, Disambiguating visual relations using
// loop constraints, CVPR 2010). Returns one result per edge, in their order. Throws
// std::invalid_argument for nodes out of range.
[[nodiscard]] std::vector<CycleSupport> check_cycles(int nodes,
                                                     const std::vector<RelativeRotation>& edges,
                                                     double max_deg);

// Nodes of the largest connected component, ascending. Of two equally large ones it is the one with
// the smallest node.
[[nodiscard]] std::vector<int> largest_component(int nodes,
                                                 const std::vector<RelativeRotation>& edges);

// Radius of a connected graph: the number of edges from a central node to the farthest one. The
// central node is the middle of a longest path that two breadth-first searches find, so the result
// may be slightly too large.
[[nodiscard]] int radius(int nodes, const std::vector<RelativeRotation>& edges);

}  // namespace tarsier::sfm
