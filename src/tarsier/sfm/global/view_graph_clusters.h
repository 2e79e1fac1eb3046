// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <cstdint>
#include <stop_token>
#include <vector>

// Clusters of a view graph that can be mapped apart and joined by the images that they share.
namespace tarsier::sfm {

// Two images that were verified against each other.
struct WeightedEdge {
  int first = 0;
  int second = 0;
  double weight = 1;  // > 0: verified matches
};

struct ClusterOptions {
  int clusters = 1;
  int max_size = 500;  // own images of a cluster; clusters * max_size >= nodes
  int overlap = 30;    // images that a cluster takes of each neighbour
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"clusters", clusters, at_least(1)},
            {"max_size", max_size, at_least(1)},
            {"overlap", overlap, at_least(0)}};
  }
  void check() const { check_fields(*this); }
};

struct ViewCluster {
  std::vector<int> own;     // ascending; each image is the own one of one cluster
  std::vector<int> shared;  // own ones of neighbours, ascending
  [[nodiscard]] std::vector<int> images() const;  // both, ascending
};

// `clusters` clusters of a graph of `nodes` images, some of which may be empty where there are fewer images than clusters.
//
// The partition is by recursive bisection. Images are ordered by the eigenvector of the second smallest eigenvalue of
// (D - W) v = lambda D v, with the weights W and their sums D (Shi and Malik, Normalized cuts and image segmentation, PAMI
// 2000), found by inverse iteration; components that do not hang together follow each other in that order, the largest
// first. It is cut where
//
//   Ncut(A, B) = cut(A, B) / assoc(A) + cut(A, B) / assoc(B)
//
// is least among the places that leave each side at most max_size images for each of its clusters, and within a quarter of
// its even share. Then each cluster grows by images of its neighbours, one after the other the one whose matches with the
// cluster so far are most (in the spirit of Chen, Shen, Chen and Wang, Graph-based parallel large scale structure from
// motion, Pattern Recognition 2020, and of Bhowmick, Patra, Chatterjee, Govindu and Banerjee, Divide and conquer: efficient
// large-scale structure from motion using graph partitioning, ACCV 2014): `overlap` of each neighbour along a maximum
// spanning tree of the clusters by the weights cut between them, then of the others, those with most weight first, as long
// as a cluster has not grown by half. Clusters hang together by their images wherever the graph does.
//
// The same for the same arguments. Throws std::invalid_argument for nodes or weights out of range, clusters that cannot hold
// the images, Interrupted.
[[nodiscard]] std::vector<ViewCluster> cluster_view_graph(int nodes,
                                                          const std::vector<WeightedEdge>& edges,
                                                          const ClusterOptions& options,
                                                          const std::stop_token& stop = {});

}  // namespace tarsier::sfm
