// SPDX-License-Identifier: MIT
#include "tarsier/sfm/global/rotation_averaging.h"

#include "tarsier/core/angles.h"
#include "tarsier/core/at.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/linalg/sparse_cholesky.h"

#include <Eigen/SparseCore>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr double kHalfWeight = 50;  // verified matches at which an edge counts half
// radians, lower limit for the weights of the sum of absolute angles
constexpr double kMinAngle = 1e-3;
constexpr double kDamping = 1e-9;  // share of the Laplacian's diagonal

// Rotations along the spanning tree of maximum weight; empty where the graph is not connected.
std::vector<Eigen::Matrix3d> spanning_tree_rotations(int nodes,
                                                     const std::vector<RelativeRotation>& edges) {
  std::vector<std::size_t> order(edges.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return edges[a].weight > edges[b].weight; });
  Components components(at(nodes));
  std::vector<std::vector<std::size_t>> tree(at(nodes));
  int joined = 1;
  for (const std::size_t e : order) {
    if (!components.join(edges[e].first, edges[e].second)) continue;
    tree[at(edges[e].first)].push_back(e);
    tree[at(edges[e].second)].push_back(e);
    ++joined;
  }
  if (joined != nodes) return {};
  std::vector<Eigen::Matrix3d> rotations(at(nodes), Eigen::Matrix3d::Identity());
  std::vector<char> known(at(nodes), 0);
  std::vector<int> queue{0};
  known[0] = 1;
  for (std::size_t k = 0; k < queue.size(); ++k) {
    const int node = queue[k];
    for (const std::size_t e : tree[at(node)]) {
      const RelativeRotation& edge = edges[e];
      const int other = edge.first == node ? edge.second : edge.first;
      if (known[at(other)] != 0) continue;
      known[at(other)] = 1;
      const Eigen::Matrix3d& own = rotations[at(node)];
      rotations[at(other)] = edge.first == node
                                 ? Eigen::Matrix3d(edge.second_from_first * own)
                                 : Eigen::Matrix3d(edge.second_from_first.transpose() * own);
      queue.push_back(other);
    }
  }
  return rotations;
}

// Weighted steps of all nodes but the first, which is fixed.
class Averaging {
 public:
  Averaging(const std::vector<RelativeRotation>& edges, std::vector<Eigen::Matrix3d>& rotations)
      : edges_(edges), rotations_(rotations), laplacian_(size(), size()) {
    compute_residuals();
  }

  [[nodiscard]] const std::vector<Eigen::Vector3d>& residuals() const { return residuals_; }

  // Returns the largest change, radians. Nothing changes where the equations have no solution.
  double step(const std::vector<double>& weights) {
    std::vector<Eigen::Triplet<double>> entries;
    Eigen::MatrixX3d right = Eigen::MatrixX3d::Zero(size(), 3);
    for (std::size_t e = 0; e < edges_.size(); ++e) {
      const int low = std::min(edges_[e].first, edges_[e].second) - 1;
      const int high = std::max(edges_[e].first, edges_[e].second) - 1;
      if (low >= 0) entries.emplace_back(low, high, -weights[e]);
      const Eigen::RowVector3d weighted_residual = weights[e] * residuals_[e].transpose();
      if (const int i = edges_[e].first - 1; i >= 0) {
        entries.emplace_back(i, i, weights[e] * (1 + kDamping));
        right.row(i) -= weighted_residual;
      }
      if (const int j = edges_[e].second - 1; j >= 0) {
        entries.emplace_back(j, j, weights[e] * (1 + kDamping));
        right.row(j) += weighted_residual;
      }
    }
    laplacian_.setFromTriplets(entries.begin(), entries.end());
    if (!analyzed_) factor_.analyze(laplacian_);
    analyzed_ = true;
    if (!factor_.factorize(laplacian_)) return 0;
    Eigen::MatrixX3d steps(size(), 3);
    for (int k = 0; k < 3; ++k) steps.col(k) = factor_.solve(right.col(k));
    if (!steps.allFinite()) return 0;
    double max_change = 0;
    for (Eigen::Index i = 0; i < size(); ++i) {
      const Eigen::Vector3d rotation_step = steps.row(i).transpose();
      max_change = std::max(max_change, rotation_step.norm());
      Eigen::Matrix3d& rotation = rotations_[static_cast<std::size_t>(i) + 1];
      rotation = geometry::rotation_of(
          geometry::quaternion_of(rotation * geometry::rotation_by(rotation_step)));
    }
    compute_residuals();
    return max_change;
  }

 private:
  [[nodiscard]] Eigen::Index size() const {
    return static_cast<Eigen::Index>(rotations_.size()) - 1;
  }

  void compute_residuals() {
    residuals_.clear();
    for (const RelativeRotation& edge : edges_)
      residuals_.push_back(geometry::rotation_vector(rotations_[at(edge.second)].transpose() *
                                                     edge.second_from_first *
                                                     rotations_[at(edge.first)]));
  }

  const std::vector<RelativeRotation>& edges_;
  std::vector<Eigen::Matrix3d>& rotations_;
  std::vector<Eigen::Vector3d> residuals_;
  Eigen::SparseMatrix<double> laplacian_;
  linalg::SparseCholesky factor_;
  bool analyzed_ = false;
};

}  // namespace

AveragedRotations average_rotations(int nodes, const std::vector<RelativeRotation>& edges,
                                    const RotationAveragingOptions& options,
                                    const std::stop_token& stop) {
  options.check();
  for (const RelativeRotation& edge : edges)
    TARSIER_REQUIRE(edge.first >= 0 && edge.second >= 0 && edge.first < nodes &&
                        edge.second < nodes && edge.first != edge.second && edge.weight > 0,
                    "edge from {} to {} with weight {}, in a graph of {} nodes", edge.first,
                    edge.second, edge.weight, nodes);
  AveragedRotations result;
  result.rotations = spanning_tree_rotations(nodes, edges);
  TARSIER_REQUIRE(nodes >= 2 && !result.rotations.empty(),
                  "the view graph of {} nodes is not connected", nodes);
  Averaging averaging(edges, result.rotations);
  const double sigma = options.sigma_deg * kRadiansPerDegree;
  std::vector<double> weights(edges.size());
  const int max_iterations = options.l1_iterations + options.max_iterations;
  while (result.iterations < max_iterations) {
    throw_if_stopped(stop);
    const bool is_first_part = result.iterations < options.l1_iterations;
    for (std::size_t e = 0; e < edges.size(); ++e) {
      const double angle = averaging.residuals()[e].norm();
      const double robust = is_first_part
                                ? kMinAngle / std::max(angle, kMinAngle)
                                : std::pow(sigma * sigma / (sigma * sigma + angle * angle), 2);
      weights[e] = edges[e].weight / (edges[e].weight + kHalfWeight) * std::max(robust, 1e-9);
    }
    ++result.iterations;
    const double change = averaging.step(weights);
    if (change > options.tolerance_deg * kRadiansPerDegree) continue;
    if (!is_first_part) break;
    result.iterations = options.l1_iterations;
  }
  for (const Eigen::Vector3d& residual : averaging.residuals())
    result.errors_deg.push_back(residual.norm() / kRadiansPerDegree);
  return result;
}

}  // namespace tarsier::sfm
