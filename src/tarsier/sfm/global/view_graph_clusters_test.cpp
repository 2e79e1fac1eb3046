// SPDX-License-Identifier: MIT
#include "tarsier/sfm/global/view_graph_clusters.h"

#include "tarsier/core/errors.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <set>
#include <stdexcept>
#include <vector>

namespace tarsier::sfm {
namespace {

// A row of images, each matched with the next `reach` ones; nearer pairs have more matches.
std::vector<WeightedEdge> chain(int nodes, int reach, bool closed = false) {
  std::vector<WeightedEdge> edges;
  for (int i = 0; i < nodes; ++i)
    for (int d = 1; d <= reach; ++d)
      if (closed || i + d < nodes) edges.push_back({i, (i + d) % nodes, 100.0 / d});
  return edges;
}

void expect_partition(const std::vector<ViewCluster>& clusters, int nodes, int max_size) {
  std::vector<int> all;
  for (const ViewCluster& cluster : clusters) {
    EXPECT_LE(cluster.own.size(), static_cast<std::size_t>(max_size));
    EXPECT_TRUE(std::is_sorted(cluster.own.begin(), cluster.own.end()));
    EXPECT_TRUE(std::is_sorted(cluster.shared.begin(), cluster.shared.end()));
    all.insert(all.end(), cluster.own.begin(), cluster.own.end());
    const std::vector<int> images = cluster.images();
    EXPECT_EQ(std::set<int>(images.begin(), images.end()).size(),
              cluster.own.size() + cluster.shared.size());
  }
  std::sort(all.begin(), all.end());
  ASSERT_EQ(all.size(), static_cast<std::size_t>(nodes));
  for (int i = 0; i < nodes; ++i) EXPECT_EQ(all[static_cast<std::size_t>(i)], i);
}

std::size_t common(const ViewCluster& a, const ViewCluster& b) {
  const std::vector<int> first = a.images();
  const std::vector<int> second = b.images();
  std::vector<int> both;
  std::set_intersection(first.begin(), first.end(), second.begin(), second.end(),
                        std::back_inserter(both));
  return both.size();
}

TEST(ViewGraphClusters, ChainIsCutIntoOverlappingPieces) {
  const auto clusters =
      cluster_view_graph(100, chain(100, 5), {.clusters = 4, .max_size = 28, .overlap = 5});
  expect_partition(clusters, 100, 28);
  std::vector<int> begins;
  for (const ViewCluster& cluster : clusters) {
    EXPECT_EQ(cluster.own.back() - cluster.own.front() + 1, static_cast<int>(cluster.own.size()))
        << "a piece has a hole";
    begins.push_back(cluster.own.front());
    // The images that it shares with its neighbours are directly beside it.
    for (const int image : cluster.shared)
      EXPECT_TRUE(image >= cluster.own.front() - 5 && image <= cluster.own.back() + 5) << image;
  }
  std::vector<ViewCluster> sorted = clusters;
  std::sort(sorted.begin(), sorted.end(), [](const ViewCluster& a, const ViewCluster& b) {
    return a.own.front() < b.own.front();
  });
  for (std::size_t k = 0; k + 1 < sorted.size(); ++k)
    EXPECT_EQ(common(sorted[k], sorted[k + 1]), 10U);
}

TEST(ViewGraphClusters, RingClustersOverlapBothNeighbours) {
  const auto clusters = cluster_view_graph(1000, chain(1000, 6, true),
                                           {.clusters = 10, .max_size = 120, .overlap = 10});
  expect_partition(clusters, 1000, 120);
  for (std::size_t a = 0; a < clusters.size(); ++a) {
    int neighbours = 0;
    for (std::size_t b = 0; b < clusters.size(); ++b)
      if (a != b && common(clusters[a], clusters[b]) >= 10) ++neighbours;
    EXPECT_EQ(neighbours, 2) << a;
  }
}

// Two scenes of 40 and 20 images with a single weak pair between them.
TEST(ViewGraphClusters, CutIsBetweenWeaklyConnectedScenes) {
  std::vector<WeightedEdge> edges = chain(40, 8);
  for (WeightedEdge edge : chain(20, 8))
    edges.push_back({edge.first + 40, edge.second + 40, edge.weight});
  edges.push_back({3, 45, 20});
  const auto clusters =
      cluster_view_graph(60, edges, {.clusters = 2, .max_size = 45, .overlap = 4});
  expect_partition(clusters, 60, 45);
  // An even cut would be at 30; 40 is outside a quarter around it.
  for (const ViewCluster& cluster : clusters) EXPECT_GE(cluster.own.size(), 22U);
  edges = chain(35, 8);
  for (WeightedEdge edge : chain(25, 8))
    edges.push_back({edge.first + 35, edge.second + 35, edge.weight});
  edges.push_back({3, 45, 20});
  const auto apart = cluster_view_graph(60, edges, {.clusters = 2, .max_size = 45, .overlap = 4});
  std::multiset<std::size_t> sizes;
  for (const ViewCluster& cluster : apart) sizes.insert(cluster.own.size());
  EXPECT_EQ(sizes, (std::multiset<std::size_t>{25, 35}));
}

TEST(ViewGraphClusters, UnconnectedScenesAreNotMixed) {
  std::vector<WeightedEdge> edges;
  for (const int start : {0, 25, 50, 75})
    for (WeightedEdge edge : chain(25, 4))
      edges.push_back({edge.first + start, edge.second + start, edge.weight});
  const auto clusters =
      cluster_view_graph(100, edges, {.clusters = 4, .max_size = 25, .overlap = 5});
  expect_partition(clusters, 100, 25);
  for (const ViewCluster& cluster : clusters) {
    EXPECT_EQ(cluster.own.size(), 25U);
    EXPECT_EQ(cluster.own.front() / 25, cluster.own.back() / 25);
    EXPECT_TRUE(cluster.shared.empty());
  }
}

// A grid of aerial images. Compact pieces cut few pairs.
TEST(ViewGraphClusters, GridIsCutIntoCompactPieces) {
  constexpr int kSide = 20;
  std::vector<WeightedEdge> edges;
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      if (x + 1 < kSide) edges.push_back({y * kSide + x, y * kSide + x + 1, 50});
      if (y + 1 < kSide) edges.push_back({y * kSide + x, (y + 1) * kSide + x, 50});
    }
  }
  const auto clusters =
      cluster_view_graph(kSide * kSide, edges, {.clusters = 4, .max_size = 120, .overlap = 10});
  expect_partition(clusters, kSide * kSide, 120);
  std::vector<std::size_t> of(kSide * kSide);
  for (std::size_t c = 0; c < clusters.size(); ++c)
    for (const int image : clusters[c].own) of[static_cast<std::size_t>(image)] = c;
  int cut = 0;
  for (const WeightedEdge& edge : edges)
    cut += of[static_cast<std::size_t>(edge.first)] != of[static_cast<std::size_t>(edge.second)]
               ? 1
               : 0;
  EXPECT_LE(cut, 65);  // two straight lines cut 40, four random parts 570
  // All clusters are connected by their shared images.
  std::set<std::size_t> reached{0};
  for (std::size_t round = 0; round < clusters.size(); ++round)
    for (std::size_t a = 0; a < clusters.size(); ++a)
      for (std::size_t b = 0; b < clusters.size(); ++b)
        if (reached.count(a) > 0 && common(clusters[a], clusters[b]) >= 10) reached.insert(b);
  EXPECT_EQ(reached.size(), clusters.size());
}

TEST(ViewGraphClusters, AcceptsFewImagesAndNoPairs) {
  expect_partition(cluster_view_graph(3, {}, {.clusters = 5, .max_size = 4}), 3, 4);
  expect_partition(cluster_view_graph(10, {}, {.clusters = 3, .max_size = 4}), 10, 4);
  expect_partition(cluster_view_graph(7, chain(7, 2), {.clusters = 1, .max_size = 7}), 7, 7);
  EXPECT_THROW((void)cluster_view_graph(9, {}, {.clusters = 2, .max_size = 4}),
               std::invalid_argument);
  EXPECT_THROW((void)cluster_view_graph(9, {{0, 9, 1}}, {}), std::invalid_argument);
  EXPECT_THROW((void)cluster_view_graph(9, {{0, 1, 0}}, {}), std::invalid_argument);
  EXPECT_THROW((void)cluster_view_graph(9, {{2, 2, 1}}, {}), std::invalid_argument);
}

TEST(ViewGraphClusters, IsDeterministicAndCanBeInterrupted) {
  const auto edges = chain(200, 7, true);
  const ClusterOptions options{.clusters = 6, .max_size = 40, .overlap = 6};
  const auto one = cluster_view_graph(200, edges, options);
  const auto other = cluster_view_graph(200, edges, options);
  for (std::size_t c = 0; c < one.size(); ++c) {
    EXPECT_EQ(one[c].own, other[c].own);
    EXPECT_EQ(one[c].shared, other[c].shared);
  }
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW((void)cluster_view_graph(200, edges, options, stop.get_token()), Interrupted);
}

}  // namespace
}  // namespace tarsier::sfm
