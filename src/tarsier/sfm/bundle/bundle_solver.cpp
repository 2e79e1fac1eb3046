// SPDX-License-Identifier: MIT
#include "tarsier/sfm/bundle/bundle_solver.h"

#include "tarsier/core/at.h"
#include "tarsier/core/require.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/linalg/decompositions.h"
#include "tarsier/linalg/sparse_cholesky.h"
#include "tarsier/sfm/bundle/bundle_cost.h"
#include "tarsier/sfm/bundle/bundle_equations.h"
#include "tarsier/sfm/bundle/bundle_residual.h"
#include "tarsier/sfm/bundle/local_damping.h"
#include "tarsier/sfm/bundle/schur_kernel.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <utility>

namespace tarsier::sfm {
namespace {

// min ratio of the loss's curvature along a residual to that perpendicular to it
constexpr double kMinCurvature = 0.05;
constexpr double kHighGain = 1.4;  // share of the predicted gain
// share of the predicted gain; below, the second order is used
constexpr double kMaxSecondOrderGain = 0.9;
constexpr double kFirstDamping = 1e-4;   // share of the diagonal
constexpr double kMinDamping = 1e-14;    // a loop of 10 000 images bends only with less than 1e-12
constexpr double kNoiseDamping = 1e-12;  // for the steps caused by noise
constexpr double kMaxDamping = 1e12;
constexpr int kChainPoses = 80;  // with more poses, a model may be a long chain that bends
// For such models. Bending a long chain changes each residual only little, so that damping prevents
// the bend until it is below this value. A small change before that does not indicate the minimum.
constexpr double kMaxFinalDamping = 1e-10;
constexpr double kDampingReduction = 1e-3;  // factor of the damping after a small change
constexpr double kMaxAcceleration = 0.75;   // max ratio of twice the second order to the step
constexpr double kMinGain = 1e-3;
constexpr int kMinStripeVariables = 16;  // min variables whose columns one thread processes
constexpr int kMaxStripes = 32;
constexpr int kMaxDensePoses = 80;  // with up to these, a dense system is always faster
constexpr double kPreconditionedTolerance = 0.1;  // costs a hundredth of the gain of an exact step
constexpr int kMaxPreconditionedIterations = 6;

using Matrix6x3 = Eigen::Matrix<double, 6, 3>;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

class Solver {
 public:
  Solver(BundleProblem& problem, const BundleSolverOptions& options, const std::stop_token& stop)
      : problem_(problem),
        options_(options),
        stop_(stop),
        variables_(problem),
        local_damping_(variables_.poses) {
    is_sparse_ = options_.system == CameraSystem::kSparse ||
                 (options_.system == CameraSystem::kAutomatic && variables_.poses > kMaxDensePoses);
    cut_into_stripes();
  }

  BundleSolution run() {
    BundleSolution solution;
    Candidate now{{problem_.poses, problem_.lenses, problem_.points}, {}, 0};
    now.costs = costs_of(problem_, now.state);
    now.sum = solution.cost_before = now.costs.sum();
    if (!std::isfinite(now.sum)) {
      solution.error = "a point is behind a camera that observes it, or is not finite";
      return solution;
    }
    double damping = kFirstDamping;
    double growth = 2;                    // of the damping, at the next failed step (Nielsen, 1999)
    bool has_low_damping_failed = false;  // since the last change that was not small
    bool is_linearized = false;
    while (solution.iterations < options_.max_iterations &&
           variables_.size + variables_.moving_points > 0) {
      throw_if_stopped(stop_);
      ++solution.iterations;
      if (!is_linearized) linearize(problem_, variables_, now.state, curvature_, equations_);
      is_linearized = true;
      double predicted_gain = 0;
      BundleStep step;
      std::optional<Candidate> next;
      if (solve_step(damping, step, predicted_gain)) next = best_of(now, step, predicted_gain);
      if (!next || !is_good(now, *next, predicted_gain)) {
        // No further gain is possible.
        if (next && std::isfinite(next->sum) && predicted_gain <= options_.tolerance * now.sum)
          break;
        uses_second_order_ = variables_.poses > kChainPoses;
        if (curvature_ < 1) {  // not as close to the minimum as assumed
          curvature_ = std::min(1.0, 4 * curvature_);
          is_linearized = false;
          continue;
        }
        // There is no bend that damping prevents: another try would fail, too.
        if (damping <= kMaxFinalDamping) has_low_damping_failed = true;
        if (next && damp_locally(now, *next)) continue;
        damping *= growth;
        growth *= 2;
        if (damping > kMaxDamping) break;
        continue;
      }
      const double change = now.sum - next->sum;
      const bool is_done = change <= options_.tolerance * now.sum;
      now = std::move(*next);
      is_linearized = false;
      // More than predicted: the loss has less curvature along residuals than assumed.
      if (change > kHighGain * predicted_gain) curvature_ = std::max(kMinCurvature, curvature_ / 2);
      const double gain = std::min(change / predicted_gain, 2.0);
      if (gain < kMaxSecondOrderGain) uses_second_order_ = variables_.poses > kChainPoses;
      damping = std::max(kMinDamping, damping * std::max(1.0 / 9, 1 - std::pow(2 * gain - 1, 3)));
      growth = 2;
      local_damping_.lower();
      if (is_done) {
        if (variables_.poses <= kChainPoses || damping <= kMaxFinalDamping ||
            has_low_damping_failed)
          break;
        damping = std::max(kMaxFinalDamping, kDampingReduction * damping);
      } else {
        has_low_damping_failed = false;
      }
    }
    throw_if_stopped(stop_);
    solution.cost_after = now.sum;
    problem_.poses = std::move(now.state.poses);
    problem_.lenses = std::move(now.state.lenses);
    problem_.points = std::move(now.state.points);
    return solution;
  }

  // The steps caused by noise in all observations, one per sample; fewer where the equations cannot
  // be solved.
  std::vector<VectorXd> steps_of_noise(double sigma_px, int samples, std::uint64_t seed) {
    std::vector<VectorXd> steps;
    const std::vector<Vector2d> residuals = residuals_of(problem_);
    if (residuals.size() != problem_.measurements.size() || variables_.size == 0) return steps;
    std::vector<Vector2d> predicted;
    for (std::size_t k = 0; k < residuals.size(); ++k) {
      const BundleProblem::Measurement& seen = problem_.measurements[k];
      predicted.emplace_back(Vector2d(seen.u, seen.v) + residuals[k] / seen.weight);
    }
    const BundleState state{problem_.poses, problem_.lenses, problem_.points};
    const Rng rng(seed);
    for (int sample = 0; sample < samples; ++sample) {
      Rng noise = rng.fork(static_cast<std::uint64_t>(sample));
      for (std::size_t k = 0; k < predicted.size(); ++k) {
        BundleProblem::Measurement& seen = problem_.measurements[k];
        seen.u = predicted[k][0] + noise.normal(0, sigma_px) / seen.weight;
        seen.v = predicted[k][1] + noise.normal(0, sigma_px) / seen.weight;
      }
      linearize(problem_, variables_, state, 1, equations_);
      BundleStep step;
      if (sample == 0) {
        double predicted_gain = 0;
        if (!solve_step(kNoiseDamping, step, predicted_gain)) break;
      } else {
        step.variables = -equations_.gradient;
        for (const std::size_t p : variables_.order)
          if (problem_.point_moves[p] != 0)
            eliminate_right(p, equations_.point_gradient[p], step.variables);
        if (!solve_cameras(step.variables) || !step.variables.allFinite()) break;
      }
      steps.push_back(std::move(step.variables));
    }
    return steps;
  }

  [[nodiscard]] const BundleVariables& variables() const { return variables_; }

 private:
  using Entry = BundleVariables::Entry;

  // A state and its cost.
  struct Candidate {
    BundleState state;
    BundleCosts costs;
    double sum = 0;
  };

  static bool is_good(const Candidate& now, const Candidate& next, double predicted_gain) {
    return now.sum - next.sum > kMinGain * predicted_gain;
  }

  [[nodiscard]] Candidate after(const Candidate& now, const BundleStep& step) const {
    Candidate next;
    next.state = moved_by(problem_, variables_, now.state, step, 1);
    next.costs = costs_of(problem_, next.state);
    refine_raised_points(problem_, now.state, now.costs, next.state, next.costs);
    next.sum = next.costs.sum();
    return next;
  }

  // Damps only the poses at which the cost of a failed step rises; false where that is no help.
  bool damp_locally(const Candidate& now, const Candidate& failed) {
    if (variables_.poses <= kChainPoses || !std::isfinite(failed.sum)) return false;
    std::vector<double> rises(at(variables_.poses), 0);
    for (std::size_t p = 0; p < problem_.points.size(); ++p) {
      const double rise = (failed.costs.point_costs[p] - now.costs.point_costs[p]) /
                          static_cast<double>(problem_.first[p + 1] - problem_.first[p]);
      for (std::size_t k = problem_.first[p]; k < problem_.first[p + 1]; ++k) {
        const int variable = variables_.pose_variable[at(problem_.measurements[k].pose)];
        if (variable >= 0) rises[at(variable)] += rise;
      }
    }
    return local_damping_.raise(rises);
  }

  // The step with the second order of its path, if that improves, else without. Where a few points
  // move far, their second order misleads all cameras.
  Candidate best_of(const Candidate& now, const BundleStep& step, double predicted_gain) {
    if (uses_second_order_) {
      BundleStep accelerated = step;
      if (accelerate(now.state, accelerated)) {
        Candidate next = after(now, accelerated);
        if (is_good(now, next, predicted_gain)) return next;
      }
    }
    return after(now, step);
  }

  // The mixed second derivatives of a variable and its point.
  [[nodiscard]] Eigen::Map<const MatrixNx3> mixed_of(const Entry& entry) const {
    return {equations_.mixed.data() + entry.offset, variables_.size_of(entry.variable), 3};
  }

  // The amount that damping adds to a diagonal number.
  static double damped(double damping, double diagonal) {
    return damping * std::max(diagonal, 1e-9);
  }

  // The damping of a variable, share of the diagonal.
  [[nodiscard]] double damping_of(int variable, double damping) const {
    return variable < variables_.poses ? damping + local_damping_.of(variable) : damping;
  }

  // False where the equations cannot be solved. `predicted_gain`: predicted reduction of the cost.
  bool solve_step(double damping, BundleStep& step, double& predicted_gain) {
    reduced_.assign(variables_.block_values, 0.0);
    for (int v = 0; v < variables_.poses; ++v)
      std::copy_n(equations_.blocks.data() + variables_.pose_block_offset(v), 36,
                  reduced_.data() + variables_.diagonal_offset(v));
    std::copy(equations_.blocks.begin() +
                  static_cast<std::ptrdiff_t>(variables_.lens_block_offset(variables_.lens_offset)),
              equations_.blocks.end(),
              reduced_.begin() + static_cast<std::ptrdiff_t>(variables_.lens_offset));
    for (int v = 0; v < variables_.count; ++v) {
      const std::size_t stride = at(variables_.size_of(v)) + 1;  // of the diagonal
      for (int k = 0; k < variables_.size_of(v); ++k)
        reduced_[variables_.diagonal_offset(v) + at(k) * stride] +=
            damped(damping_of(v, damping), equations_.scale[variables_.offset_of(v) + k]);
    }
    VectorXd& moved = step.variables;
    moved = -equations_.gradient;
    const std::size_t points = problem_.points.size();
    point_inverse_.resize(points);
    if (!eliminate(damping, moved)) return false;
    if (variables_.size > 0 && !(is_sparse_ ? factor_sparse() : factor_dense())) return false;
    if (!solve_cameras(moved) || !moved.allFinite()) return false;
    solve_points(equations_.point_gradient, step);
    predicted_gain = 0;
    for (int v = 0; v < variables_.count; ++v) {
      const int first = variables_.offset_of(v);
      for (int k = first; k < first + variables_.size_of(v); ++k)
        predicted_gain +=
            moved[k] * (damped(damping_of(v, damping), equations_.scale[k]) * moved[k] -
                        equations_.gradient[k]);
    }
    for (std::size_t p = 0; p < points; ++p)
      for (int k = 0; k < 3; ++k)
        predicted_gain += step.points[p][k] *
                          (damped(damping, equations_.point_hessian[p](k, k)) * step.points[p][k] -
                           equations_.point_gradient[p][k]);
    predicted_gain /= 2;
    return std::isfinite(predicted_gain) && predicted_gain > 0;
  }

  // The steps of moving points, given the step of the cameras and lenses.
  void solve_points(const std::vector<Vector3d>& gradient, BundleStep& step) const {
    step.points.assign(problem_.points.size(), Vector3d::Zero());
    for (std::size_t p = 0; p < step.points.size(); ++p) {
      if (problem_.point_moves[p] == 0) continue;
      Vector3d right = -gradient[p];
      for (std::size_t e = variables_.entry_first[p]; e < variables_.entry_first[p + 1]; ++e) {
        const int v = variables_.entries[e].variable;
        right -= mixed_of(variables_.entries[e]).transpose() *
                 step.variables.segment(variables_.offset_of(v), variables_.size_of(v));
      }
      step.points[p] = point_inverse_[p] * right;
    }
  }

  // Adds the second order of the path to a step (geodesic acceleration: Transtrum and Sethna,
  // Improvements to the Levenberg-Marquardt algorithm for nonlinear least-squares minimization,
  // 2012). With the step d, h = kSecondOrderShare and the residuals r,
  // r'' = 2/h ((r(x + h d) - r(x)) / h - J d), and a solves the same equations for -J^T r'' in
  // place of -J^T r; the step is d + a / 2. The weights of the loss are kept. False where a is not
  // small compared with d: the step is then unchanged.
  bool accelerate(const BundleState& now, BundleStep& step) {
    VectorXd gradient;
    std::vector<Vector3d> point_gradient;
    if (!second_derivative(problem_, variables_, now, step, curvature_, gradient, point_gradient))
      return false;
    BundleStep acceleration;
    acceleration.variables = -gradient;
    for (std::size_t p = 0; p < point_gradient.size(); ++p)
      if (problem_.point_moves[p] != 0)
        eliminate_right(p, point_gradient[p], acceleration.variables);
    if (!solve_cameras(acceleration.variables) || !acceleration.variables.allFinite()) return false;
    const double size = equations_.scale.dot(step.variables.cwiseAbs2());
    const double acceleration_size = equations_.scale.dot(acceleration.variables.cwiseAbs2());
    if (2 * std::sqrt(acceleration_size) > kMaxAcceleration * std::sqrt(size)) return false;
    solve_points(point_gradient, acceleration);
    step.variables += 0.5 * acceleration.variables;
    for (std::size_t p = 0; p < step.points.size(); ++p)
      step.points[p] += 0.5 * acceleration.points[p];
    return true;
  }

  // Subtracts a point's gradient from the right side of the cameras' equations.
  void eliminate_right(std::size_t p, const Vector3d& gradient, VectorXd& right) const {
    const Vector3d offset = point_inverse_[p] * gradient;
    for (std::size_t e = variables_.entry_first[p]; e < variables_.entry_first[p + 1]; ++e) {
      const int v = variables_.entries[e].variable;
      right.segment(variables_.offset_of(v), variables_.size_of(v)) +=
          mixed_of(variables_.entries[e]).lazyProduct(offset);
    }
  }

  // Eliminates the points from the equations; false where that is impossible.
  bool eliminate(double damping, VectorXd& right) {
    if (!invert_points(damping)) return false;
    for (const std::size_t p : variables_.order)
      if (problem_.point_moves[p] != 0) eliminate_right(p, equations_.point_gradient[p], right);
    cv::parallel_for_(
        cv::Range(0, static_cast<int>(stripes_.size())),
        [&](const cv::Range& range) {
          for (int stripe = range.start; stripe < range.end; ++stripe)
            eliminate_columns(stripes_[at(stripe)]);
        },
        static_cast<double>(stripes_.size()));
    return true;
  }

  // The columns of the equations that one thread processes, and their points, in order.
  struct Stripe {
    int begin = 0;  // index of variables
    int end = 0;
    std::vector<std::size_t> points;
  };

  void cut_into_stripes() {
    const int count = std::clamp(variables_.count / kMinStripeVariables, 1, kMaxStripes);
    for (int k = 0; k < count; ++k)
      stripes_.push_back({variables_.count * k / count, variables_.count * (k + 1) / count, {}});
    for (const std::size_t p : variables_.order) {
      if (problem_.point_moves[p] == 0) continue;
      std::size_t stripe = 0;
      for (std::size_t e = variables_.entry_first[p]; e < variables_.entry_first[p + 1]; ++e) {
        while (variables_.entries[e].variable >= stripes_[stripe].end) ++stripe;
        std::vector<std::size_t>& points = stripes_[stripe].points;
        if (points.empty() || points.back() != p) points.push_back(p);
      }
    }
  }

  bool invert_points(double damping) {
    std::atomic<bool> is_good = true;
    for_each_point(problem_, [&](std::size_t p) {
      if (problem_.point_moves[p] == 0) return;
      Matrix3d hessian = equations_.point_hessian[p];
      for (int k = 0; k < 3; ++k) hessian(k, k) += damped(damping, hessian(k, k));
      const Eigen::LLT<Matrix3d> factor(hessian);
      if (factor.info() != Eigen::Success) is_good = false;
      point_inverse_[p] = factor.solve(Matrix3d::Identity());
    });
    return is_good;
  }

  // Subtracts the points from the columns of a stripe.
  void eliminate_columns(const Stripe& stripe) {
    std::vector<PoseBlock> list;
    const auto is_before = [](const Entry& entry, int variable) {
      return entry.variable < variable;
    };
    for (const std::size_t p : stripe.points) {
      const auto first =
          variables_.entries.begin() + static_cast<std::ptrdiff_t>(variables_.entry_first[p]);
      const auto last =
          variables_.entries.begin() + static_cast<std::ptrdiff_t>(variables_.entry_first[p + 1]);
      for (auto column = std::lower_bound(first, last, stripe.begin, is_before);
           column != last && column->variable < stripe.end; ++column)
        eliminate_column(p, static_cast<int>(column - first), list);
    }
  }

  // The same for one point, from the column of its entry l. `list` is scratch memory.
  void eliminate_column(std::size_t p, int l, std::vector<PoseBlock>& list) {
    const Entry* entries = variables_.entries.data() + variables_.entry_first[p];
    const Entry& column = entries[l];
    const Matrix3d& inverse = point_inverse_[p];
    if (column.variable < variables_.poses) {
      const Matrix6x3 scaled =
          Eigen::Map<const Matrix6x3>(equations_.mixed.data() + column.offset).lazyProduct(inverse);
      list.clear();
      for (int k = 0; k <= l; ++k)
        list.push_back({equations_.mixed.data() + entries[k].offset,
                        reduced_.data() + variables_.offset_of(p, k, l)});
      subtract_(scaled.data(), list.data(), l + 1);
      return;
    }
    const int columns = variables_.size_of(column.variable);
    const MatrixNx3 scaled = mixed_of(column).lazyProduct(inverse);
    for (int k = 0; k <= l; ++k) {
      const int rows = variables_.size_of(entries[k].variable);
      Eigen::Map<MatrixXd>(reduced_.data() + variables_.offset_of(p, k, l), rows, columns) -=
          mixed_of(entries[k]).lazyProduct(scaled.transpose());
    }
  }

  bool factor_dense() {
    dense_.setZero(variables_.size, variables_.size);
    for (const BundleVariables::Block& block : variables_.blocks) {
      const int rows = variables_.size_of(block.row);
      const int columns = variables_.size_of(block.column);
      dense_.block(variables_.offset_of(block.column), variables_.offset_of(block.row), columns,
                   rows) =
          Eigen::Map<const MatrixXd>(reduced_.data() + block.offset, rows, columns).transpose();
    }
    return dense_factor_.compute(dense_);
  }

  // Replaces `right` by the solution. False where the matrix is not positive definite.
  bool solve_cameras(VectorXd& right) {
    if (variables_.size == 0) return true;
    if (!is_sparse_) {
      right = dense_factor_.solve(right);
      return true;
    }
    if (is_of_earlier_step_) {
      std::optional<VectorXd> solution = sparse_factor_.solve_near(
          reduced_, right, kPreconditionedTolerance, kMaxPreconditionedIterations);
      if (solution) {
        right = std::move(*solution);
        return true;
      }
      is_of_earlier_step_ = false;
      if (!factorize()) return false;
    }
    right = sparse_factor_.solve(right);
    return true;
  }

  bool factor_sparse() {
    if (!is_analyzed_) {
      linalg::BlockPattern pattern;
      for (int v = 0; v < variables_.count; ++v) pattern.first.push_back(variables_.offset_of(v));
      pattern.first.push_back(variables_.size);
      for (const BundleVariables::Block& block : variables_.blocks)
        pattern.blocks.push_back({block.row, block.column});
      sparse_factor_.analyze(pattern);
      is_analyzed_ = true;
    }
    is_of_earlier_step_ = is_factorized_ && sparse_factor_.is_costly();
    return is_of_earlier_step_ || factorize();
  }

  bool factorize() { return is_factorized_ = sparse_factor_.factorize(reduced_); }

  BundleProblem& problem_;
  const BundleSolverOptions& options_;
  const std::stop_token& stop_;
  const BundleVariables variables_;
  LocalDamping local_damping_;  // of moving poses
  NormalEquations equations_;
  bool is_sparse_ = false;
  bool uses_second_order_ = false;  // steps use the second order
  // min ratio of the curvature along a residual to that perpendicular to it; kMinCurvature to 1
  double curvature_ = 1;

  const SubtractProducts subtract_ = subtract_products();
  std::vector<Stripe> stripes_;
  std::vector<double> reduced_;  // the blocks after elimination of points
  std::vector<Matrix3d> point_inverse_;
  MatrixXd dense_;
  linalg::Cholesky dense_factor_;
  bool is_analyzed_ = false;
  bool is_factorized_ = false;
  // the factorisation is from an earlier step and still near enough
  bool is_of_earlier_step_ = false;
  linalg::SparseCholesky sparse_factor_;
};

void check(const BundleProblem& problem) {
  TARSIER_REQUIRE(
      problem.pose_moves.size() == problem.poses.size() &&
          problem.point_moves.size() == problem.points.size() &&
          problem.first.size() == problem.points.size() + 1,
      "{} poses and {} points: each needs a flag, and each point a range of measurements",
      problem.poses.size(), problem.points.size());
}

}  // namespace

BundleSolution solve(BundleProblem& problem, const BundleSolverOptions& options,
                     const std::stop_token& stop) {
  options.check();
  check(problem);
  return Solver(problem, options, stop).run();
}

std::vector<Vector2d> residuals_of(const BundleProblem& problem) {
  std::vector<Vector2d> residuals;
  residuals.reserve(problem.measurements.size());
  for (std::size_t p = 0; p < problem.points.size(); ++p) {
    for (std::size_t k = problem.first[p]; k < problem.first[p + 1]; ++k) {
      const BundleProblem::Measurement& seen = problem.measurements[k];
      Vector2d residual;
      if (!residual_of(seen, problem.lenses[at(seen.lens)],
                       problem.poses[at(seen.pose)] * problem.points[p], residual, nullptr,
                       nullptr))
        return {};
      residuals.push_back(residual);
    }
  }
  return residuals;
}

std::vector<std::vector<Vector3d>> centers_under_noise(BundleProblem problem, double sigma_px,
                                                       int samples, std::uint64_t seed) {
  check(problem);
  TARSIER_REQUIRE(sigma_px >= 0 && samples >= 1, "{} samples with a noise of {} px", samples,
                  sigma_px);
  problem.loss_px = 0;
  const BundleSolverOptions options;
  const std::stop_token never;
  Solver solver(problem, options, never);
  std::vector<std::vector<Vector3d>> result;
  for (const VectorXd& step : solver.steps_of_noise(sigma_px, samples, seed)) {
    std::vector<Vector3d>& centers = result.emplace_back();
    for (std::size_t i = 0; i < problem.poses.size(); ++i) {
      const int variable = solver.variables().pose_variable[i];
      centers.push_back(problem.poses[i].center());
      if (variable >= 0)
        centers.back() += step.segment<3>(solver.variables().offset_of(variable) + 3);
    }
  }
  if (result.size() != static_cast<std::size_t>(samples)) result.clear();
  return result;
}

}  // namespace tarsier::sfm
