// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <cstdint>
#include <stop_token>
#include <vector>

// Clusters of a view graph that can be mapped separately and joined by their shared images.
namespace tarsier::sfm {

// Two images with verified matches.
struct WeightedEdge {
  int first = 0;
  int second = 0;
  double weight = 1;  // > 0, number of verified matches
};

struct ClusterOptions {
  int clusters = 1;
  int max_size = 500;  // max number of a cluster's own images; clusters * max_size >= nodes
  int overlap = 30;    // images that a cluster takes from each neighbour
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"clusters", clusters, at_least(1)},
            {"max_size", max_size, at_least(1)},
            {"overlap", overlap, at_least(0)}};
  }
  void check() const { check_fields(*this); }
};

struct ViewCluster {
  std::vector<int> own;     // ascending; each image is an own image of exactly one cluster
  std::vector<int> shared;  // own images of neighbours, ascending
  [[nodiscard]] std::vector<int> images() const;  // both, ascending
};

// Divides a graph of `nodes` images into `clusters` clusters. Some are empty where there are fewer
// images than clusters.
//
// The partition is made by recursive bisection. Images are ordered by the eigenvector of the second
// smallest eigenvalue of (D - W) v = lambda D v, found by inverse iteration. W are the weights and
// D their row sums (Shi and Malik, Normalized cuts and image segmentation, PAMI 2000). Connected
// components follow each other in that order, the largest first. The cut minimises
//
//   Ncut(A, B) = cut(A, B) / assoc(A) + cut(A, B) / assoc(B)
//
// among the positions that give each side at most max_size images for each of its clusters, and
// that differ from its even share by at most a quarter.
//
// Then each cluster grows by images of its neighbours. The next image is always the one with most
// matches to the cluster (in the spirit of Chen, Shen, Chen and Wang, Graph-based parallel large
// scale structure from motion, Pattern Recognition 2020, and of Bhowmick, Patra, Chatterjee,
// Govindu and Banerjee, Divide and conquer: efficient large-scale structure from motion using graph
// partitioning, ACCV 2014). It takes `overlap` images from each neighbour along a maximum spanning
// tree of the clusters, by the weights cut between them. Then the other neighbours follow, those
// with most weight first, until the cluster has grown by half. Clusters are connected by shared
// images wherever the graph is.
//
// Deterministic. Throws std::invalid_argument for nodes or weights out of range or for clusters
// that cannot hold the images, Interrupted.
[[nodiscard]] std::vector<ViewCluster> cluster_view_graph(int nodes,
                                                          const std::vector<WeightedEdge>& edges,
                                                          const ClusterOptions& options,
                                                          const std::stop_token& stop = {});

}  // namespace tarsier::sfm
