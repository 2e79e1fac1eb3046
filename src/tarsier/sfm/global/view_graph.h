// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <vector>

// The view graph: images are nodes, verified pairs are edges with the rotation between the two cameras.
namespace tarsier::sfm {

struct RelativeRotation {
  int first = 0;
  int second = 0;
  Eigen::Matrix3d second_from_first = Eigen::Matrix3d::Identity();
  double weight = 1;  // > 0: verified matches
};

// Which nodes hang together: union-find.
class Components {
 public:
  explicit Components(std::size_t count);
  int root(int node);
  // False where they hung together before.
  bool join(int a, int b);

 private:
  std::vector<int> parents_;
};

// Of an edge: cycles of three edges that it is in, and those of them whose rotations come back to where they began.
struct CycleSupport {
  int cycles = 0;
  int closed = 0;
};

// Walks around each triangle of the graph; one is closed if what remains of its three rotations is at most `max_deg`
// (Zach, Klopschitz and Pollefeys, Disambiguating visual relations using loop constraints, CVPR 2010). Of each edge, in
// their order. Throws std::invalid_argument for nodes out of range.
[[nodiscard]] std::vector<CycleSupport> check_cycles(int nodes,
                                                     const std::vector<RelativeRotation>& edges,
                                                     double max_deg);

// Nodes of the largest part of the graph that hangs together, ascending; of two as large the one with the first node.
[[nodiscard]] std::vector<int> largest_component(int nodes,
                                                 const std::vector<RelativeRotation>& edges);

// The radius of a connected graph: edges from a middle node to the farthest one. The middle node is that of a longest way
// which two breadth-first searches find, so that the result may be too large by some.
[[nodiscard]] int radius(int nodes, const std::vector<RelativeRotation>& edges);

}  // namespace tarsier::sfm
