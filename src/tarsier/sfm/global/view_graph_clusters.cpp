// SPDX-License-Identifier: MIT
#include "tarsier/sfm/global/view_graph_clusters.h"

#include "tarsier/core/at.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/linalg/sparse_cholesky.h"
#include "tarsier/sfm/global/view_graph.h"

#include <Eigen/Core>
#include <Eigen/SparseCore>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <limits>
#include <map>
#include <numeric>
#include <utility>

namespace tarsier::sfm {
namespace {

// added to the eigenvalues, so that the matrix is invertible
constexpr double kEigenvalueShift = 1e-9;
constexpr int kIterations = 200;  // max iterations of inverse iteration
constexpr double kConverged = 1e-7;
constexpr double kMaxImbalance = 0.25;  // max relative deviation of a side from its even share

struct Neighbour {
  int node = 0;
  double weight = 0;
};
using Graph = std::vector<std::vector<Neighbour>>;

Graph graph_of(int nodes, const std::vector<WeightedEdge>& edges) {
  Graph graph(at(nodes));
  for (const WeightedEdge& edge : edges) {
    TARSIER_REQUIRE(edge.first >= 0 && edge.first < nodes && edge.second >= 0 &&
                        edge.second < nodes && edge.first != edge.second,
                    "edge from {} to {}, in a graph of {} nodes", edge.first, edge.second, nodes);
    TARSIER_REQUIRE(edge.weight > 0 && std::isfinite(edge.weight), "edge weight {}", edge.weight);
    graph[at(edge.first)].push_back({edge.second, edge.weight});
    graph[at(edge.second)].push_back({edge.first, edge.weight});
  }
  return graph;
}

// Recursive bisection. run() returns the cluster of each node.
class Bisection {
 public:
  Bisection(const Graph& graph, const ClusterOptions& options, const std::stop_token& stop)
      : graph_(graph), options_(options), stop_(stop), index_(graph.size(), -1) {}

  std::vector<int> run() {
    std::vector<int> nodes(graph_.size());
    std::iota(nodes.begin(), nodes.end(), 0);
    cluster_of_.assign(graph_.size(), 0);
    divide(std::move(nodes), 0, options_.clusters);
    return std::move(cluster_of_);
  }

 private:
  void divide(std::vector<int> nodes, int first, int clusters) {
    if (clusters == 1 || nodes.empty()) {
      for (const int node : nodes) cluster_of_[at(node)] = first;
      return;
    }
    throw_if_stopped(stop_);
    const int left = clusters / 2;
    const std::vector<int> order = ordered(nodes);
    const auto cut_position = order.begin() + best_cut(order, left, clusters);
    std::vector<int> a(order.begin(), cut_position);
    std::vector<int> b(cut_position, order.end());
    std::sort(a.begin(), a.end());
    std::sort(b.begin(), b.end());
    nodes.clear();
    divide(std::move(a), first, left);
    divide(std::move(b), first + left, clusters - left);
  }

  // Number of nodes, in this order, that go to the first `left` clusters.
  std::ptrdiff_t best_cut(const std::vector<int>& order, int left, int clusters) {
    const auto count = static_cast<double>(order.size());
    const double even_size = count * left / clusters;
    const double low = std::max(count - static_cast<double>(clusters - left) * options_.max_size,
                                std::floor(even_size * (1 - kMaxImbalance)));
    const double high = std::min(static_cast<double>(left) * options_.max_size,
                                 std::ceil(even_size * (1 + kMaxImbalance)));
    for (const int node : order) index_[at(node)] = 0;
    double all = 0;
    for (const int node : order) all += degree(node);
    double cut = 0;
    double volume = 0;
    double best = std::numeric_limits<double>::infinity();
    double best_imbalance = 0;
    std::ptrdiff_t result = 0;
    for (std::size_t k = 0; k <= order.size(); ++k) {
      const auto size = static_cast<double>(k);
      if (size >= low && size <= high) {
        const double cost = cut_cost(cut, volume, all - volume);
        const double imbalance = std::abs(size - even_size);
        if (cost < best || (cost == best && imbalance < best_imbalance)) {
          best = cost;
          best_imbalance = imbalance;
          result = static_cast<std::ptrdiff_t>(k);
        }
      }
      if (k == order.size()) break;
      const int node = order[k];
      for (const Neighbour& other : graph_[at(node)]) {
        if (index_[at(other.node)] < 0) continue;
        cut += index_[at(other.node)] == 1 ? -other.weight : other.weight;
      }
      index_[at(node)] = 1;
      volume += degree(node);
    }
    for (const int node : order) index_[at(node)] = -1;
    return result;
  }

  // 0 between unconnected components, where rounding may leave a small rest.
  static double cut_cost(double cut, double a, double b) {
    if (cut <= 1e-12 * (a + b)) return 0;
    return cut / a + cut / b;
  }

  // Only within the nodes that are being divided.
  [[nodiscard]] double degree(int node) const {
    double sum = 0;
    for (const Neighbour& other : graph_[at(node)])
      if (index_[at(other.node)] >= 0) sum += other.weight;
    return sum;
  }

  std::vector<int> ordered(const std::vector<int>& nodes) {
    for (const int node : nodes) index_[at(node)] = 0;
    std::vector<std::vector<int>> components;
    for (const int start : nodes) {
      if (index_[at(start)] != 0) continue;
      std::vector<int>& component = components.emplace_back(1, start);
      index_[at(start)] = 1;
      for (std::size_t k = 0; k < component.size(); ++k) {
        for (const Neighbour& other : graph_[at(component[k])]) {
          if (index_[at(other.node)] != 0) continue;
          index_[at(other.node)] = 1;
          component.push_back(other.node);
        }
      }
      std::sort(component.begin(), component.end());
    }
    for (const int node : nodes) index_[at(node)] = -1;
    std::stable_sort(components.begin(), components.end(),
                     [](const auto& a, const auto& b) { return a.size() > b.size(); });
    std::vector<int> order;
    for (const std::vector<int>& component : components) {
      const std::vector<int> part = ordered_component(component);
      order.insert(order.end(), part.begin(), part.end());
    }
    return order;
  }

  std::vector<int> ordered_component(const std::vector<int>& nodes) {
    if (nodes.size() < 3) return nodes;
    const Eigen::VectorXd values = second_eigenvector(nodes);
    std::vector<int> order(nodes.size());
    std::iota(order.begin(), order.end(), 0);
    std::stable_sort(order.begin(), order.end(),
                     [&](int a, int b) { return values[a] < values[b]; });
    for (int& k : order) k = nodes[at(k)];
    return order;
  }

  Eigen::VectorXd second_eigenvector(const std::vector<int>& nodes) {
    const auto count = static_cast<Eigen::Index>(nodes.size());
    for (std::size_t k = 0; k < nodes.size(); ++k) index_[at(nodes[k])] = static_cast<int>(k);
    Eigen::VectorXd degrees(count);
    std::vector<Eigen::Triplet<double>> elements;
    for (std::size_t k = 0; k < nodes.size(); ++k) {
      const int row = static_cast<int>(k);
      degrees[row] = degree(nodes[k]);
      elements.emplace_back(row, row, degrees[row] * (1 + kEigenvalueShift));
      for (const Neighbour& other : graph_[at(nodes[k])])
        if (const int column = index_[at(other.node)]; column > row)
          elements.emplace_back(row, column, -other.weight);
    }
    for (const int node : nodes) index_[at(node)] = -1;
    Eigen::SparseMatrix<double> matrix(count, count);
    matrix.setFromTriplets(elements.begin(), elements.end());
    linalg::SparseCholesky cholesky;
    cholesky.analyze(matrix);
    Rng rng(options_.seed);
    Eigen::VectorXd vector(count);
    for (double& value : vector) value = rng.uniform(-1, 1);
    // The weights differ by more than doubles can represent: keep the order of the images.
    if (!cholesky.factorize(matrix)) {
      std::iota(vector.begin(), vector.end(), 0.0);
      return vector;
    }
    const double total = degrees.sum();
    const auto without_constant = [&](const Eigen::VectorXd& v) -> Eigen::VectorXd {
      const Eigen::VectorXd rest = v.array() - v.dot(degrees) / total;
      return rest / std::sqrt(rest.cwiseAbs2().dot(degrees));
    };
    vector = without_constant(vector);
    for (int k = 0; k < kIterations; ++k) {
      throw_if_stopped(stop_);
      const Eigen::VectorXd next = without_constant(cholesky.solve(degrees.cwiseProduct(vector)));
      const double change = std::sqrt((next - vector).cwiseAbs2().dot(degrees));
      vector = next;
      if (change < kConverged) break;
    }
    if (vector[0] > 0) vector = -vector;
    return vector;
  }

  const Graph& graph_;
  const ClusterOptions& options_;
  const std::stop_token& stop_;
  std::vector<int> index_;  // per node; -1: not among the nodes being divided
  std::vector<int> cluster_of_;
};

// The weights cut between clusters, by (first, second), first < second.
using CutWeights = std::map<std::pair<int, int>, double>;

CutWeights cut_weights_of(const std::vector<WeightedEdge>& edges,
                          const std::vector<int>& cluster_of) {
  CutWeights cut_weights;
  for (const WeightedEdge& edge : edges) {
    const auto [a, b] = std::minmax(cluster_of[at(edge.first)], cluster_of[at(edge.second)]);
    if (a != b) cut_weights[{a, b}] += edge.weight;
  }
  return cut_weights;
}

struct NeighbourCluster {
  int cluster = 0;
  bool in_tree = false;
};

// The neighbours of each cluster, those of the maximum spanning tree first.
std::vector<std::vector<NeighbourCluster>> neighbours_of(int clusters,
                                                         const CutWeights& cut_weights) {
  std::vector<std::pair<double, std::pair<int, int>>> order;
  for (const auto& [pair, weight] : cut_weights) order.emplace_back(-weight, pair);
  std::sort(order.begin(), order.end());
  Components joined(at(clusters));
  std::vector<std::vector<NeighbourCluster>> result(at(clusters));
  std::vector<std::pair<int, int>> others;
  const auto add = [&](const std::pair<int, int>& pair, bool in_tree) {
    result[at(pair.first)].push_back({pair.second, in_tree});
    result[at(pair.second)].push_back({pair.first, in_tree});
  };
  for (const auto& [weight, pair] : order) {
    if (joined.join(pair.first, pair.second))
      add(pair, true);
    else
      others.push_back(pair);
  }
  for (const auto& pair : others) add(pair, false);
  return result;
}

void grow(const Graph& graph, const std::vector<ViewCluster>& before,
          const std::vector<NeighbourCluster>& neighbours, int overlap, ViewCluster& cluster) {
  std::map<int, double> gain;  // per node next to the cluster: its weight to the cluster
  std::vector<char> is_in(graph.size(), 0);
  const auto add_node = [&](int node) {
    is_in[at(node)] = 1;
    gain.erase(node);
    for (const Neighbour& other : graph[at(node)])
      if (is_in[at(other.node)] == 0) gain[other.node] += other.weight;
  };
  for (const int node : cluster.own) add_node(node);
  const std::size_t max_shared = std::max(at(overlap), cluster.own.size() / 2);
  for (const NeighbourCluster& next : neighbours) {
    for (int k = 0; k < overlap; ++k) {
      if (!next.in_tree && cluster.shared.size() >= max_shared) return;
      int best = -1;
      for (const int node : before[at(next.cluster)].own) {
        const auto found = gain.find(node);
        if (found != gain.end() && (best < 0 || found->second > gain.at(best))) best = node;
      }
      if (best < 0) break;
      cluster.shared.push_back(best);
      add_node(best);
    }
  }
}

}  // namespace

std::vector<int> ViewCluster::images() const {
  std::vector<int> all;
  std::merge(own.begin(), own.end(), shared.begin(), shared.end(), std::back_inserter(all));
  return all;
}

std::vector<ViewCluster> cluster_view_graph(int nodes, const std::vector<WeightedEdge>& edges,
                                            const ClusterOptions& options,
                                            const std::stop_token& stop) {
  options.check();
  TARSIER_REQUIRE(
      nodes >= 0 && static_cast<std::int64_t>(options.clusters) * options.max_size >= nodes,
      "{} nodes in {} clusters of {}", nodes, options.clusters, options.max_size);
  const Graph graph = graph_of(nodes, edges);
  const std::vector<int> cluster_of = Bisection(graph, options, stop).run();
  std::vector<ViewCluster> clusters(at(options.clusters));
  for (int node = 0; node < nodes; ++node) clusters[at(cluster_of[at(node)])].own.push_back(node);
  const auto neighbours = neighbours_of(options.clusters, cut_weights_of(edges, cluster_of));
  std::vector<ViewCluster> grown = clusters;
  for (std::size_t c = 0; c < grown.size(); ++c) {
    throw_if_stopped(stop);
    grow(graph, clusters, neighbours[c], options.overlap, grown[c]);
    std::sort(grown[c].shared.begin(), grown[c].shared.end());
  }
  return grown;
}

}  // namespace tarsier::sfm
