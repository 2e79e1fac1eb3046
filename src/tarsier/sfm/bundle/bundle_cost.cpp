// SPDX-License-Identifier: MIT
#include "tarsier/sfm/bundle/bundle_cost.h"

#include "tarsier/core/at.h"
#include "tarsier/sfm/bundle/bundle_residual.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>

namespace tarsier::sfm {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// a point is refined if its cost exceeds this times its cost before the step
constexpr double kMaxCostRatio = 1.05;
constexpr int kMaxPointSteps = 6;    // per refined point
constexpr double kSmallGain = 1e-3;  // share of the cost; a step with a smaller gain is the last

using Eigen::Matrix2d;
using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Matrix2x3 = Eigen::Matrix<double, 2, 3>;

double loss(const BundleProblem& problem, double squares) {
  const double c2 = problem.loss_px * problem.loss_px;
  return c2 > 0 ? c2 * std::log1p(squares / c2) : squares;
}

// The cost of a point if it were at `position`.
double cost_of(const BundleProblem& problem, const BundleState& state, std::size_t p,
               const Vector3d& position) {
  Vector2d residual;
  double sum = 0;
  for (std::size_t k = problem.first[p]; k < problem.first[p + 1]; ++k) {
    const BundleProblem::Measurement& seen = problem.measurements[k];
    if (!residual_of(seen, state.lenses[at(seen.lens)], state.poses[at(seen.pose)] * position,
                     residual, nullptr, nullptr))
      return kInfinity;
    sum += loss(problem, residual.squaredNorm());
  }
  return std::isfinite(sum) ? 0.5 * sum : kInfinity;
}

// Moves a point in front of all its cameras to a lower cost. `cost` is updated.
void refine(const BundleProblem& problem, const BundleState& state, std::size_t p,
            Vector3d& position, double& cost) {
  Vector2d residual;
  Matrix2d factor;
  Matrix2x3 by_position;
  double damping = 1e-4;
  for (int step = 0; step < kMaxPointSteps; ++step) {
    Matrix3d hessian = Matrix3d::Zero();
    Vector3d gradient = Vector3d::Zero();
    for (std::size_t k = problem.first[p]; k < problem.first[p + 1]; ++k) {
      const BundleProblem::Measurement& seen = problem.measurements[k];
      const geometry::Rigid3& pose = state.poses[at(seen.pose)];
      if (!residual_of(seen, state.lenses[at(seen.lens)], pose * position, residual, &by_position,
                       nullptr))
        return;
      weigh(problem.loss_px, 1, residual, factor);
      const Matrix2x3 by_point = factor * by_position * pose.rotation;
      hessian.noalias() += by_point.transpose() * by_point;
      gradient.noalias() += by_point.transpose() * residual;
    }
    hessian.diagonal() *= 1 + damping;
    const Vector3d next = position - hessian.ldlt().solve(gradient);
    const double next_cost = next.allFinite() ? cost_of(problem, state, p, next) : kInfinity;
    if (!(next_cost < cost)) {
      damping *= 30;
      continue;
    }
    damping /= 10;
    const bool is_last = cost - next_cost < kSmallGain * cost;
    position = next;
    cost = next_cost;
    if (is_last) break;
  }
}

}  // namespace

double BundleCosts::sum() const {
  return std::accumulate(point_costs.begin(), point_costs.end(), prior);
}

BundleCosts costs_of(const BundleProblem& problem, const BundleState& state) {
  BundleCosts costs;
  costs.point_costs.resize(problem.points.size());
  for_each_point(problem, [&](std::size_t p) {
    costs.point_costs[p] = cost_of(problem, state, p, state.points[p]);
  });
  if (problem.prior) {
    const double residual = prior_residual(*problem.prior, state);
    costs.prior = 0.5 * residual * residual;
  }
  return costs;
}

void refine_raised_points(const BundleProblem& problem, const BundleState& before,
                          const BundleCosts& costs_before, BundleState& after, BundleCosts& costs) {
  for_each_point(problem, [&](std::size_t p) {
    double& cost = costs.point_costs[p];
    if (problem.point_moves[p] == 0 || cost <= kMaxCostRatio * costs_before.point_costs[p]) return;
    const double unmoved = cost_of(problem, after, p, before.points[p]);
    if (unmoved < cost) {
      cost = unmoved;
      after.points[p] = before.points[p];
    }
    if (std::isfinite(cost)) refine(problem, after, p, after.points[p], cost);
  });
}

}  // namespace tarsier::sfm
