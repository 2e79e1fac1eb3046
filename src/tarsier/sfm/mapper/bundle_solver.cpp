// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/bundle_solver.h"

#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/linalg/decompositions.h"
#include "tarsier/linalg/sparse_cholesky.h"
#include "tarsier/sfm/mapper/bundle_residual.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/SparseCore>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr double kMinCurvature = 0.05;  // of the loss along a residual, a share of that across
constexpr double kGoodGain = 1.4;       // of what a step promised
constexpr double kStraightGain = 0.9;   // of what a step promised; below, the second order is used
constexpr double kFirstDamping = 1e-4;  // share of the diagonal
constexpr double kMinDamping = 1e-12;
constexpr double kMaxDamping = 1e12;
constexpr int kChainPoses = 80;  // beyond, a model may be a long chain that bends
// Of such models. Bending a long chain changes each residual by little, so that damping holds the bend back until it is
// this low: a small change before that does not mean that the minimum is reached.
constexpr double kFreeDamping = 1e-10;
constexpr double kRelease = 1e-3;   // of the damping, where a change was small
constexpr double kPathShare = 0.1;  // of a step, at which the second order of its path is measured
constexpr double kMaxBend = 0.75;   // of twice the second order beside the step
constexpr double kMinGain = 1e-3;
constexpr int kDensePoses = 300;
constexpr int kFewPoses = 80;       // up to which a dense system is faster in any case
constexpr double kThinShare = 0.2;  // of all blocks, below which a sparse system is faster

using Matrix2x3 = Eigen::Matrix<double, 2, 3>;
using Matrix2x6 = Eigen::Matrix<double, 2, 6>;
using Matrix2xN = Eigen::Matrix<double, 2, Eigen::Dynamic, 0, 2, 9>;
using Matrix6x3 = Eigen::Matrix<double, 6, 3>;
using MatrixNx3 = Eigen::Matrix<double, Eigen::Dynamic, 3, 0, 9, 3>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Eigen::Matrix2d;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

std::size_t at(int i) { return static_cast<std::size_t>(i); }

// What moves.
struct State {
  std::vector<geometry::Rigid3> poses;
  std::vector<LensNumbers> lenses;
  std::vector<Eigen::Vector3d> points;
};

class Solver {
 public:
  Solver(BundleProblem& problem, const BundleSolverOptions& options, const std::stop_token& stop)
      : problem_(problem), options_(options), stop_(stop) {
    number_variables();
    find_entries();
    find_blocks();
  }

  BundleSolution run() {
    BundleSolution solution;
    State now{problem_.poses, problem_.lenses, problem_.points};
    const std::optional<double> start = cost(now);
    if (!start) {
      solution.trouble = "a point lies behind a camera that shows it, or is not finite";
      return solution;
    }
    double sum = solution.cost_before = *start;
    double damping = kFirstDamping;
    double growth = 2;  // of the damping, at the next step that is no good (Nielsen, 1999)
    bool is_linear = false;
    while (solution.iterations < options_.max_iterations && size_ + movers_ > 0) {
      throw_if_stopped(stop_);
      ++solution.iterations;
      if (!is_linear) linearize(now);
      is_linear = true;
      State next;
      double promised = 0;
      std::optional<double> candidate;
      if (step(now, damping, next, promised)) candidate = cost(next);
      const double change = candidate ? sum - *candidate : 0;
      if (!candidate || !(change > kMinGain * promised)) {
        if (candidate && promised <= options_.tolerance * sum) break;  // no more to be had
        bends_ = poses_ > kChainPoses;
        if (curvature_ < 1) {  // not as near as it looked
          curvature_ = std::min(1.0, 4 * curvature_);
          is_linear = false;
          continue;
        }
        damping *= growth;
        growth *= 2;
        if (damping > kMaxDamping) break;
        continue;
      }
      now = std::move(next);
      is_linear = false;
      const bool is_done = change <= options_.tolerance * sum;
      // More than it promised: the loss bends less along residuals than is reckoned with.
      if (change > kGoodGain * promised) curvature_ = std::max(kMinCurvature, curvature_ / 2);
      sum = *candidate;
      const double gain = std::min(change / promised, 2.0);
      if (gain < kStraightGain) bends_ = poses_ > kChainPoses;
      damping = std::max(kMinDamping, damping * std::max(1.0 / 9, 1 - std::pow(2 * gain - 1, 3)));
      growth = 2;
      if (is_done) {
        if (poses_ <= kChainPoses || damping <= kFreeDamping) break;
        damping = std::max(kFreeDamping, kRelease * damping);
      }
    }
    throw_if_stopped(stop_);
    solution.cost_after = sum;
    problem_.poses = std::move(now.poses);
    problem_.lenses = std::move(now.lenses);
    problem_.points = std::move(now.points);
    return solution;
  }

 private:
  // A pose or a lens that a point is seen by.
  struct Entry {
    int variable = 0;
    std::size_t offset = 0;  // in mixed_
  };
  // Of the camera system: variables (row <= column), and where its numbers lie, column by column.
  struct Block {
    int row = 0;
    int column = 0;
    std::size_t offset = 0;
  };

  [[nodiscard]] int size_of(int variable) const {
    return variable < poses_ ? 6 : static_cast<int>(problem_.free_numbers.size());
  }
  [[nodiscard]] int offset_of(int variable) const {
    return variable < poses_ ? 6 * variable : 6 * poses_ + (variable - poses_) * size_of(variable);
  }

  // --- what there is, once for all steps ---

  void number_variables() {
    pose_variable_.assign(problem_.poses.size(), -1);
    for (std::size_t i = 0; i < problem_.poses.size(); ++i)
      if (problem_.pose_moves[i] != 0) pose_variable_[i] = poses_++;
    variables_ = poses_;
    lens_variable_.assign(problem_.lenses.size(), -1);
    if (!problem_.free_numbers.empty())
      for (int& variable : lens_variable_) variable = variables_++;
    size_ = 0;
    for (int v = 0; v < variables_; ++v) size_ += size_of(v);
    movers_ = std::count_if(problem_.point_moves.begin(), problem_.point_moves.end(),
                            [](char moves) { return moves != 0; });
  }

  void find_entries() {
    const std::size_t points = problem_.points.size();
    entry_first_.reserve(points + 1);
    pair_first_.reserve(points + 1);
    pose_entry_.assign(problem_.seen.size(), -1);
    lens_entry_.assign(problem_.seen.size(), -1);
    std::vector<int> variables;
    std::size_t mixed = 0;
    std::size_t pairs = 0;
    for (std::size_t p = 0; p < points; ++p) {
      entry_first_.push_back(entries_.size());
      pair_first_.push_back(pairs);
      variables.clear();
      for (std::size_t k = problem_.first[p]; k < problem_.first[p + 1]; ++k) {
        for (const int v : {pose_variable_[at(problem_.seen[k].pose)],
                            lens_variable_[at(problem_.seen[k].lens)]}) {
          if (v >= 0) variables.push_back(v);
        }
      }
      std::sort(variables.begin(), variables.end());
      variables.erase(std::unique(variables.begin(), variables.end()), variables.end());
      const auto entry_of = [&](int variable) {
        const auto found = std::lower_bound(variables.begin(), variables.end(), variable);
        return variable < 0 ? -1 : static_cast<int>(found - variables.begin());
      };
      for (std::size_t k = problem_.first[p]; k < problem_.first[p + 1]; ++k) {
        pose_entry_[k] = entry_of(pose_variable_[at(problem_.seen[k].pose)]);
        lens_entry_[k] = entry_of(lens_variable_[at(problem_.seen[k].lens)]);
      }
      for (const int v : variables) {
        entries_.push_back({v, mixed});
        mixed += 3 * at(size_of(v));
      }
      pairs += variables.size() * (variables.size() + 1) / 2;
    }
    entry_first_.push_back(entries_.size());
    pair_first_.push_back(pairs);
    mixed_.resize(mixed);
  }

  // A block for each two variables that a point has in common, and which one it is for each pair
  // (k <= l) of a point's entries: at pair_first_ + l (l + 1) / 2 + k.
  void find_blocks() {
    std::vector<std::vector<std::pair<int, int>>> seen_by(at(variables_));  // point, entry
    for (std::size_t p = 0; p + 1 < entry_first_.size(); ++p)
      for (std::size_t e = entry_first_[p]; e < entry_first_[p + 1]; ++e)
        seen_by[at(entries_[e].variable)].emplace_back(static_cast<int>(p),
                                                       static_cast<int>(e - entry_first_[p]));
    // Points in an order in which those that touch the same blocks follow each other.
    order_.resize(problem_.points.size());
    std::iota(order_.begin(), order_.end(), std::size_t{0});
    const auto place = [&](std::size_t p) {
      const std::size_t first = entry_first_[p];
      const std::size_t last = entry_first_[p + 1];
      return first == last ? std::pair(-1, -1)
                           : std::pair(entries_[first].variable, entries_[last - 1].variable);
    };
    std::stable_sort(order_.begin(), order_.end(),
                     [&](std::size_t a, std::size_t b) { return place(a) < place(b); });
    pair_block_.resize(pair_first_.back());
    diagonal_.resize(at(variables_));
    std::vector<int> known(at(variables_), -1);
    std::vector<int> rows;
    std::size_t offset = 0;
    for (int column = 0; column < variables_; ++column) {
      rows.assign(1, column);
      known[at(column)] = 0;
      for (const auto& [p, l] : seen_by[at(column)]) {
        for (int k = 0; k < l; ++k) {
          const int row = entries_[entry_first_[at(p)] + at(k)].variable;
          if (known[at(row)] < 0) rows.push_back(row);
          known[at(row)] = 0;
        }
      }
      std::sort(rows.begin(), rows.end());
      for (const int row : rows) {
        known[at(row)] = static_cast<int>(blocks_.size());
        blocks_.push_back({row, column, offset});
        offset += at(size_of(row)) * at(size_of(column));
      }
      diagonal_[at(column)] = known[at(column)];
      for (const auto& [p, l] : seen_by[at(column)]) {
        int* pair = pair_block_.data() + pair_first_[at(p)] + at(l) * (at(l) + 1) / 2;
        for (int k = 0; k <= l; ++k)
          pair[k] = known[at(entries_[entry_first_[at(p)] + at(k)].variable)];
      }
      for (const int row : rows) known[at(row)] = -1;
    }
    numbers_.resize(offset);
    const double all = 0.5 * variables_ * (variables_ + 1.0);
    const bool is_thin =
        poses_ > kFewPoses && static_cast<double>(blocks_.size()) < kThinShare * all;
    is_sparse_ = options_.system == CameraSystem::kSparse ||
                 (options_.system == CameraSystem::kAutomatic && (poses_ > kDensePoses || is_thin));
  }

  // --- a step ---

  [[nodiscard]] double loss(double squares) const {
    const double c2 = problem_.loss_px * problem_.loss_px;
    return c2 > 0 ? c2 * std::log1p(squares / c2) : squares;
  }

  // Nothing where a point lies behind a camera, or is not finite.
  [[nodiscard]] std::optional<double> cost(const State& state) const {
    double sum = 0;
    Vector2d residual;
    for (std::size_t p = 0; p < state.points.size(); ++p) {
      for (std::size_t k = problem_.first[p]; k < problem_.first[p + 1]; ++k) {
        const BundleProblem::Seen& seen = problem_.seen[k];
        if (!residual_of(seen, state.lenses[at(seen.lens)],
                         state.poses[at(seen.pose)] * state.points[p], residual, nullptr, nullptr))
          return std::nullopt;
        sum += loss(residual.squaredNorm());
      }
    }
    if (problem_.hold) {
      const double off = hold_residual(state);
      sum += off * off;
    }
    if (!std::isfinite(sum)) return std::nullopt;
    return 0.5 * sum;
  }

  [[nodiscard]] double hold_residual(const State& state) const {
    const BundleProblem::Hold& hold = *problem_.hold;
    return hold.weight * (state.poses[at(hold.pose)].center()[hold.axis] - hold.value);
  }

  // A residual and its derivatives as of plain squares that have the gradient and the second
  // derivatives of the loss.
  void weigh(Vector2d& residual, Matrix2d& factor) const {
    factor.setIdentity();
    const double c2 = problem_.loss_px * problem_.loss_px;
    const double squares = residual.squaredNorm();
    if (c2 <= 0 || squares <= 0) return;
    const double x = squares / c2;
    const double slope = 1 / (1 + x);                                      // rho'
    const double along = std::max(curvature_, (1 - x) / (1 + x)) * slope;  // rho' + 2 s rho''
    const Vector2d unit = residual / std::sqrt(squares);
    factor = std::sqrt(slope) * Matrix2d::Identity() +
             (std::sqrt(along) - std::sqrt(slope)) * unit * unit.transpose();
    residual *= slope / std::sqrt(along);
  }

  void linearize(const State& state) {
    const std::size_t points = state.points.size();
    std::fill(numbers_.begin(), numbers_.end(), 0.0);
    std::fill(mixed_.begin(), mixed_.end(), 0.0);
    gradient_ = VectorXd::Zero(size_);
    point_hessian_.assign(points, Matrix3d::Zero());
    point_gradient_.assign(points, Vector3d::Zero());
    const auto& chosen = problem_.free_numbers;
    const auto free = static_cast<Eigen::Index>(chosen.size());
    Vector2d residual;
    Matrix2d factor;
    Matrix2x3 by_place;
    Matrix2x3 by_point;
    Matrix2x6 by_pose;
    Eigen::Matrix<double, 2, 9> by_lens;
    Matrix2xN by_free(2, free);
    for (std::size_t p = 0; p < points; ++p) {
      const bool moves = problem_.point_moves[p] != 0;
      for (std::size_t k = problem_.first[p]; k < problem_.first[p + 1]; ++k) {
        const BundleProblem::Seen& seen = problem_.seen[k];
        const geometry::Rigid3& pose = state.poses[at(seen.pose)];
        const Vector3d place = pose * state.points[p];
        (void)residual_of(seen, state.lenses[at(seen.lens)], place, residual, &by_place,
                          free > 0 ? &by_lens : nullptr);
        weigh(residual, factor);
        by_place = (factor * by_place).eval();
        by_point.noalias() = by_place * pose.rotation;
        if (moves) {
          point_hessian_[p].noalias() += by_point.transpose() * by_point;
          point_gradient_[p].noalias() += by_point.transpose() * residual;
        }
        const int l = pose_entry_[k];
        if (l >= 0) {
          // A small turn w after the rotation moves the point in the camera's frame by w x place.
          by_pose.col(0) = by_place.col(2) * place[1] - by_place.col(1) * place[2];
          by_pose.col(1) = by_place.col(0) * place[2] - by_place.col(2) * place[0];
          by_pose.col(2) = by_place.col(1) * place[0] - by_place.col(0) * place[1];
          by_pose.rightCols<3>() = -by_point;
          const Entry& entry = entries_[entry_first_[p] + at(l)];
          Eigen::Map<Matrix6>(numbers_.data() + blocks_[at(diagonal_[at(entry.variable)])].offset)
              .noalias() += by_pose.transpose() * by_pose;
          gradient_.segment<6>(offset_of(entry.variable)).noalias() +=
              by_pose.transpose() * residual;
          if (moves)
            Eigen::Map<Matrix6x3>(mixed_.data() + entry.offset).noalias() +=
                by_pose.transpose() * by_point;
        }
        const int m = lens_entry_[k];
        if (m < 0) continue;
        for (Eigen::Index c = 0; c < free; ++c)
          by_free.col(c) = factor * by_lens.col(chosen[static_cast<std::size_t>(c)]);
        const Entry& entry = entries_[entry_first_[p] + at(m)];
        Eigen::Map<MatrixXd>(numbers_.data() + blocks_[at(diagonal_[at(entry.variable)])].offset,
                             free, free) += by_free.transpose() * by_free;
        gradient_.segment(offset_of(entry.variable), free) += by_free.transpose() * residual;
        if (moves)
          Eigen::Map<MatrixNx3>(mixed_.data() + entry.offset, free, 3) +=
              by_free.transpose() * by_point;
        if (l >= 0)
          Eigen::Map<MatrixXd>(numbers_.data() + blocks_[at(pair(p, l, m))].offset, 6, free) +=
              by_pose.transpose() * by_free;
      }
    }
    if (problem_.hold) {
      const BundleProblem::Hold& hold = *problem_.hold;
      const int variable = pose_variable_[at(hold.pose)];
      const int number = 3 + hold.axis;
      gradient_[offset_of(variable) + number] += hold.weight * hold_residual(state);
      numbers_[blocks_[at(diagonal_[at(variable)])].offset + at(7 * number)] +=
          hold.weight * hold.weight;
    }
    scale_ = VectorXd(size_);
    for (int v = 0; v < variables_; ++v)
      for (int k = 0; k < size_of(v); ++k)
        scale_[offset_of(v) + k] =
            numbers_[blocks_[at(diagonal_[at(v)])].offset + at(k * (size_of(v) + 1))];
  }

  [[nodiscard]] int pair(std::size_t p, int k, int l) const {
    return pair_block_[pair_first_[p] + at(l) * (at(l) + 1) / 2 + at(k)];
  }

  // What damping adds to a number of the diagonal.
  static double damped(double damping, double diagonal) {
    return damping * std::max(diagonal, 1e-9);
  }

  // False where the equations cannot be solved. `promised`: what it should take off the sum.
  bool step(const State& now, double damping, State& next, double& promised) {
    reduced_ = numbers_;
    for (int v = 0; v < variables_; ++v)
      for (int k = 0; k < size_of(v); ++k)
        reduced_[blocks_[at(diagonal_[at(v)])].offset + at(k * (size_of(v) + 1))] +=
            damped(damping, scale_[offset_of(v) + k]);
    VectorXd moved = -gradient_;
    point_inverse_.resize(now.points.size());
    for (const std::size_t p : order_)
      if (problem_.point_moves[p] != 0 && !eliminate(p, damping, moved)) return false;
    if (size_ > 0 && !(is_sparse_ ? factor_sparse() : factor_dense())) return false;
    solve_cameras(moved);
    if (!moved.allFinite()) return false;
    std::vector<Vector3d> by(now.points.size(), Vector3d::Zero());
    solve_points(point_gradient_, moved, by);
    promised = 0;
    for (Eigen::Index k = 0; k < size_; ++k)
      promised += moved[k] * (damped(damping, scale_[k]) * moved[k] - gradient_[k]);
    for (std::size_t p = 0; p < by.size(); ++p)
      for (int k = 0; k < 3; ++k)
        promised += by[p][k] *
                    (damped(damping, point_hessian_[p](k, k)) * by[p][k] - point_gradient_[p][k]);
    promised /= 2;
    if (!std::isfinite(promised) || !(promised > 0)) return false;
    if (bends_) accelerate(now, moved, by);
    next = moved_by(now, moved, by, 1);
    return true;
  }

  // The state after a share of a step.
  [[nodiscard]] State moved_by(const State& now, const VectorXd& moved,
                               const std::vector<Vector3d>& by, double share) const {
    State next = now;
    for (std::size_t i = 0; i < next.poses.size(); ++i) {
      if (pose_variable_[i] < 0) continue;
      const Eigen::Index offset = offset_of(pose_variable_[i]);
      const geometry::Rigid3& pose = now.poses[i];
      next.poses[i].rotation =
          geometry::rotation_by(share * moved.segment<3>(offset)) * pose.rotation;
      next.poses[i].translation =
          -(next.poses[i].rotation * (pose.center() + share * moved.segment<3>(offset + 3)));
    }
    for (std::size_t i = 0; i < next.lenses.size(); ++i) {
      if (lens_variable_[i] < 0) continue;
      for (std::size_t k = 0; k < problem_.free_numbers.size(); ++k)
        next.lenses[i][at(problem_.free_numbers[k])] +=
            share * moved[offset_of(lens_variable_[i]) + static_cast<Eigen::Index>(k)];
    }
    for (std::size_t p = 0; p < next.points.size(); ++p) next.points[p] += share * by[p];
    return next;
  }

  // Of points that move: what they move by, when the cameras and lenses move by `moved`.
  void solve_points(const std::vector<Vector3d>& gradient, const VectorXd& moved,
                    std::vector<Vector3d>& by) const {
    for (std::size_t p = 0; p < by.size(); ++p) {
      if (problem_.point_moves[p] == 0) continue;
      Vector3d right = -gradient[p];
      for (std::size_t e = entry_first_[p]; e < entry_first_[p + 1]; ++e) {
        const int v = entries_[e].variable;
        right -= Eigen::Map<const MatrixNx3>(mixed_.data() + entries_[e].offset, size_of(v), 3)
                     .transpose() *
                 moved.segment(offset_of(v), size_of(v));
      }
      by[p] = point_inverse_[p] * right;
    }
  }

  // Adds the second order of the path to a step (geodesic acceleration: Transtrum and Sethna, Improvements to the
  // Levenberg-Marquardt algorithm for nonlinear least-squares minimization, 2012): with d the step, h = kPathShare and r
  // the residuals, r'' = 2/h ((r(x + h d) - r(x)) / h - J d), and a solves the same equations for -J^T r'' in place of
  // -J^T r; the step is d + a / 2. The loss keeps its weights meanwhile. Without effect where a is not small beside d.
  void accelerate(const State& now, VectorXd& moved, std::vector<Vector3d>& by) {
    const State ahead = moved_by(now, moved, by, kPathShare);
    VectorXd gradient = VectorXd::Zero(size_);
    std::vector<Vector3d> point_gradient(by.size(), Vector3d::Zero());
    Vector2d residual;
    Vector2d later;
    Matrix2d factor;
    Matrix2x3 by_place;
    const auto& chosen = problem_.free_numbers;
    const auto free = static_cast<Eigen::Index>(chosen.size());
    Eigen::Matrix<double, 2, 9> by_lens;
    Matrix2xN by_free(2, free);
    for (std::size_t p = 0; p < by.size(); ++p) {
      for (std::size_t k = problem_.first[p]; k < problem_.first[p + 1]; ++k) {
        const BundleProblem::Seen& seen = problem_.seen[k];
        const geometry::Rigid3& pose = now.poses[at(seen.pose)];
        const Vector3d place = pose * now.points[p];
        const LensNumbers& lens = now.lenses[at(seen.lens)];
        (void)residual_of(seen, lens, place, residual, &by_place, free > 0 ? &by_lens : nullptr);
        if (!residual_of(seen, lens, ahead.poses[at(seen.pose)] * ahead.points[p], later, nullptr,
                         nullptr))
          return;
        Vector3d along = pose.rotation * by[p];  // of the place in the camera's frame
        const int variable = pose_variable_[at(seen.pose)];
        if (variable >= 0) {
          const auto step = moved.segment<6>(offset_of(variable));
          along += Vector3d(step.head<3>()).cross(place) - pose.rotation * step.tail<3>();
        }
        Vector2d first = by_place * along;  // J d
        const int lens_variable = lens_variable_[at(seen.lens)];
        if (lens_variable >= 0) {
          for (Eigen::Index c = 0; c < free; ++c)
            by_free.col(c) = by_lens.col(chosen[static_cast<std::size_t>(c)]);
          first += by_free * moved.segment(offset_of(lens_variable), free);
        }
        const Vector2d bend = 2 / kPathShare * ((later - residual) / kPathShare - first);
        weigh(residual, factor);
        const Vector2d weighted = factor.transpose() * (factor * bend);
        const Vector3d pull = by_place.transpose() * weighted;
        if (problem_.point_moves[p] != 0) point_gradient[p] += pose.rotation.transpose() * pull;
        if (lens_variable >= 0)
          gradient.segment(offset_of(lens_variable), free) += by_free.transpose() * weighted;
        if (variable < 0) continue;
        gradient.segment<3>(offset_of(variable)) += place.cross(pull);
        gradient.segment<3>(offset_of(variable) + 3) -= pose.rotation.transpose() * pull;
      }
    }
    VectorXd bent = -gradient;
    for (std::size_t p = 0; p < by.size(); ++p)
      if (problem_.point_moves[p] != 0) eliminate_right(p, point_gradient[p], bent);
    solve_cameras(bent);
    if (!bent.allFinite()) return;
    std::vector<Vector3d> bent_by(by.size(), Vector3d::Zero());
    solve_points(point_gradient, bent, bent_by);
    const double size = scale_.dot(moved.cwiseAbs2());
    const double bent_size = scale_.dot(bent.cwiseAbs2());
    if (2 * std::sqrt(bent_size) > kMaxBend * std::sqrt(size)) return;
    moved += 0.5 * bent;
    for (std::size_t p = 0; p < by.size(); ++p) by[p] += 0.5 * bent_by[p];
  }

  // What a point's gradient takes from the right side of the cameras' equations.
  void eliminate_right(std::size_t p, const Vector3d& gradient, VectorXd& right) const {
    const Vector3d offset = point_inverse_[p] * gradient;
    for (std::size_t e = entry_first_[p]; e < entry_first_[p + 1]; ++e) {
      const int v = entries_[e].variable;
      right.segment(offset_of(v), size_of(v)) +=
          Eigen::Map<const MatrixNx3>(mixed_.data() + entries_[e].offset, size_of(v), 3)
              .lazyProduct(offset);
    }
  }

  // Takes a point out of the equations.
  bool eliminate(std::size_t p, double damping, VectorXd& right) {
    Matrix3d hessian = point_hessian_[p];
    for (int k = 0; k < 3; ++k) hessian(k, k) += damped(damping, hessian(k, k));
    const Eigen::LLT<Matrix3d> factor(hessian);
    if (factor.info() != Eigen::Success) return false;
    const Matrix3d inverse = point_inverse_[p] = factor.solve(Matrix3d::Identity());
    eliminate_right(p, point_gradient_[p], right);
    const std::size_t first = entry_first_[p];
    const int count = static_cast<int>(entry_first_[p + 1] - first);
    for (int l = 0; l < count; ++l) {
      const Entry& column = entries_[first + at(l)];
      const int columns = size_of(column.variable);
      const Eigen::Map<const MatrixNx3> own(mixed_.data() + column.offset, columns, 3);
      if (column.variable < poses_) {
        const Matrix6x3 scaled =
            Eigen::Map<const Matrix6x3>(mixed_.data() + column.offset).lazyProduct(inverse);
        for (int k = 0; k <= l; ++k)
          Eigen::Map<Matrix6>(reduced_.data() + blocks_[at(pair(p, k, l))].offset).noalias() -=
              Eigen::Map<const Matrix6x3>(mixed_.data() + entries_[first + at(k)].offset)
                  .lazyProduct(scaled.transpose());
        continue;
      }
      const MatrixNx3 scaled = own.lazyProduct(inverse);
      for (int k = 0; k <= l; ++k) {
        const Entry& row = entries_[first + at(k)];
        const int rows = size_of(row.variable);
        Eigen::Map<MatrixXd>(reduced_.data() + blocks_[at(pair(p, k, l))].offset, rows, columns) -=
            Eigen::Map<const MatrixNx3>(mixed_.data() + row.offset, rows, 3)
                .lazyProduct(scaled.transpose());
      }
    }
    return true;
  }

  bool factor_dense() {
    dense_.setZero(size_, size_);
    for (const Block& block : blocks_) {
      const int rows = size_of(block.row);
      const int columns = size_of(block.column);
      dense_.block(offset_of(block.column), offset_of(block.row), columns, rows) =
          Eigen::Map<const MatrixXd>(reduced_.data() + block.offset, rows, columns).transpose();
    }
    return dense_factor_.compute(dense_);
  }

  // `right` becomes the solution.
  void solve_cameras(VectorXd& right) {
    if (size_ == 0) return;
    right =
        is_sparse_ ? VectorXd(sparse_factor_.solve(right)) : VectorXd(dense_factor_.solve(right));
  }

  bool factor_sparse() {
    const bool is_first = sparse_.nonZeros() == 0;
    if (is_first) {
      sparse_.resize(size_, size_);
      sparse_.reserve(static_cast<Eigen::Index>(reduced_.size()));
    }
    // Blocks lie column by column, rows ascending: so do the numbers of the sparse matrix.
    Eigen::Index filled = 0;
    std::size_t begin = 0;
    for (int v = 0; v < variables_; ++v) {
      std::size_t end = begin;
      while (end < blocks_.size() && blocks_[end].column == v) ++end;
      for (int c = 0; c < size_of(v); ++c) {
        if (is_first) sparse_.startVec(offset_of(v) + c);
        for (std::size_t b = begin; b < end; ++b) {
          const Block& block = blocks_[b];
          const int rows = block.row == v ? c + 1 : size_of(block.row);
          const double* numbers = reduced_.data() + block.offset + at(c * size_of(block.row));
          for (int r = 0; r < rows; ++r) {
            if (is_first) sparse_.insertBack(offset_of(block.row) + r, offset_of(v) + c) = 1;
            sparse_.valuePtr()[filled++] = numbers[r];
          }
        }
      }
      begin = end;
    }
    if (is_first) {
      sparse_.finalize();
      sparse_factor_.analyze(sparse_);
    }
    return sparse_factor_.factorize(sparse_);
  }

  BundleProblem& problem_;
  const BundleSolverOptions& options_;
  const std::stop_token& stop_;
  int poses_ = 0;  // that move: variables 0 .. poses_ - 1; then come lenses
  int variables_ = 0;
  int size_ = 0;                    // numbers of all variables
  std::ptrdiff_t movers_ = 0;       // points that move
  std::vector<int> pose_variable_;  // of each pose, or -1
  std::vector<int> lens_variable_;
  std::vector<Entry> entries_;  // of each point, by variable
  std::vector<std::size_t> entry_first_;
  std::vector<std::size_t> pair_first_;
  std::vector<int> pose_entry_;  // of each observation: among its point's entries, or -1
  std::vector<int> lens_entry_;
  std::vector<int> pair_block_;
  std::vector<std::size_t> order_;  // of elimination
  std::vector<Block> blocks_;
  std::vector<int> diagonal_;  // block of each variable
  bool is_sparse_ = false;
  bool bends_ = false;    // steps have a second order
  double curvature_ = 1;  // at least so much as a share of that across; kMinCurvature to 1

  std::vector<double> numbers_;  // of the blocks
  std::vector<double> mixed_;    // second derivatives by a variable (rows) and a point
  VectorXd gradient_;
  VectorXd scale_;  // the diagonal without damping
  std::vector<Matrix3d> point_hessian_;
  std::vector<Vector3d> point_gradient_;

  std::vector<double> reduced_;  // numbers_ without points
  std::vector<Matrix3d> point_inverse_;
  MatrixXd dense_;
  linalg::Cholesky dense_factor_;
  Eigen::SparseMatrix<double> sparse_;
  linalg::SparseCholesky sparse_factor_;
};

}  // namespace

BundleSolution solve(BundleProblem& problem, const BundleSolverOptions& options,
                     const std::stop_token& stop) {
  TARSIER_REQUIRE(problem.pose_moves.size() == problem.poses.size() &&
                      problem.point_moves.size() == problem.points.size() &&
                      problem.first.size() == problem.points.size() + 1,
                  "a bundle of {} poses and {} points without a flag each, or a range",
                  problem.poses.size(), problem.points.size());
  return Solver(problem, options, stop).run();
}

}  // namespace tarsier::sfm
