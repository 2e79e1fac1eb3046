// SPDX-License-Identifier: MIT
#include "tarsier/sfm/bundle/bundle_equations.h"

#include "tarsier/core/at.h"
#include "tarsier/sfm/bundle/bundle_residual.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace tarsier::sfm {
namespace {

constexpr int kMaxTableVariables = 10'000;  // variables: offsets of their blocks fit into 32 bits
// share of a step at which the second order of its path is measured
constexpr double kSecondOrderShare = 0.1;

using Matrix2x3 = Eigen::Matrix<double, 2, 3>;
using Matrix2x6 = Eigen::Matrix<double, 2, 6>;
using Matrix2xN = Eigen::Matrix<double, 2, Eigen::Dynamic, 0, 2, 9>;
using Matrix6x3 = Eigen::Matrix<double, 6, 3>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Eigen::Matrix2d;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::Vector3d;
using Eigen::VectorXd;

}  // namespace

BundleVariables::BundleVariables(const BundleProblem& problem) {
  number_variables(problem);
  find_entries(problem);
  find_blocks(problem);
}

void BundleVariables::number_variables(const BundleProblem& problem) {
  pose_variable.assign(problem.poses.size(), -1);
  for (std::size_t i = 0; i < problem.poses.size(); ++i)
    if (problem.pose_moves[i] != 0) pose_variable[i] = poses++;
  lens_size = static_cast<int>(problem.free_parameters.size());
  count = poses;
  lens_variable.assign(problem.lenses.size(), -1);
  for (std::size_t i = 0; i < lens_variable.size() && !problem.free_parameters.empty(); ++i)
    if (problem.lens_moves.empty() || problem.lens_moves[i] != 0) lens_variable[i] = count++;
  size = 0;
  for (int v = 0; v < count; ++v) size += size_of(v);
  moving_points = std::count_if(problem.point_moves.begin(), problem.point_moves.end(),
                                [](char moves) { return moves != 0; });
}

void BundleVariables::find_entries(const BundleProblem& problem) {
  const std::size_t points = problem.points.size();
  entry_first.reserve(points + 1);
  pair_first.reserve(points + 1);
  pose_entry.assign(problem.measurements.size(), -1);
  lens_entry.assign(problem.measurements.size(), -1);
  entries.reserve(problem.measurements.size());
  std::vector<int> variables;
  std::size_t pairs = 0;
  for (std::size_t p = 0; p < points; ++p) {
    entry_first.push_back(entries.size());
    pair_first.push_back(pairs);
    variables.clear();
    for (std::size_t k = problem.first[p]; k < problem.first[p + 1]; ++k) {
      for (const int v : {pose_variable[at(problem.measurements[k].pose)],
                          lens_variable[at(problem.measurements[k].lens)]}) {
        if (v >= 0) variables.push_back(v);
      }
    }
    std::sort(variables.begin(), variables.end());
    variables.erase(std::unique(variables.begin(), variables.end()), variables.end());
    const auto entry_of = [&](int variable) {
      const auto found = std::lower_bound(variables.begin(), variables.end(), variable);
      return variable < 0 ? -1 : static_cast<int>(found - variables.begin());
    };
    for (std::size_t k = problem.first[p]; k < problem.first[p + 1]; ++k) {
      pose_entry[k] = entry_of(pose_variable[at(problem.measurements[k].pose)]);
      lens_entry[k] = entry_of(lens_variable[at(problem.measurements[k].lens)]);
    }
    for (const int v : variables) {
      entries.push_back({v, mixed_values});
      mixed_values += 3 * at(size_of(v));
    }
    pairs += variables.size() * (variables.size() + 1) / 2;
  }
  entry_first.push_back(entries.size());
  pair_first.push_back(pairs);
}

// Creates a block for each two variables with a common point. Stores the block of each pair (k <=
// l) of a point's entries at pair_first + l (l + 1) / 2 + k, or the offsets for all pairs of
// variables.
void BundleVariables::find_blocks(const BundleProblem& problem) {
  std::vector<std::vector<std::pair<int, int>>> seen_by(at(count));  // point, entry
  for (std::size_t p = 0; p + 1 < entry_first.size(); ++p)
    for (std::size_t e = entry_first[p]; e < entry_first[p + 1]; ++e)
      seen_by[at(entries[e].variable)].emplace_back(static_cast<int>(p),
                                                    static_cast<int>(e - entry_first[p]));
  // Orders points so that those with the same blocks are adjacent.
  order.resize(problem.points.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto sort_key = [&](std::size_t p) {
    const std::size_t first = entry_first[p];
    const std::size_t last = entry_first[p + 1];
    return first == last ? std::pair(-1, -1)
                         : std::pair(entries[first].variable, entries[last - 1].variable);
  };
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return sort_key(a) < sort_key(b); });
  const bool is_dense = count <= kMaxTableVariables && at(count) * at(count) < pair_first.back();
  if (is_dense) {
    block_offsets.resize(at(count) * at(count));
  } else {
    pair_block.resize(pair_first.back());
  }
  diagonal.resize(at(count));
  std::vector<int> known(at(count), -1);
  std::vector<int> rows;
  for (int column = 0; column < count; ++column) {
    if (column == poses) lens_offset = block_values;
    rows.assign(1, column);
    known[at(column)] = 0;
    for (const auto& [p, l] : seen_by[at(column)]) {
      for (int k = 0; k < l; ++k) {
        const int row = entries[entry_first[at(p)] + at(k)].variable;
        if (known[at(row)] < 0) rows.push_back(row);
        known[at(row)] = 0;
      }
    }
    std::sort(rows.begin(), rows.end());
    for (const int row : rows) {
      known[at(row)] = static_cast<int>(blocks.size());
      blocks.push_back({row, column, block_values});
      block_values += at(size_of(row)) * at(size_of(column));
    }
    diagonal[at(column)] = known[at(column)];
    if (is_dense) {
      for (std::size_t b = blocks.size() - rows.size(); b < blocks.size(); ++b)
        block_offsets[at(column) * at(count) + at(blocks[b].row)] =
            static_cast<std::uint32_t>(blocks[b].offset);
      for (const int row : rows) known[at(row)] = -1;
      continue;
    }
    for (const auto& [p, l] : seen_by[at(column)]) {
      int* pair = pair_block.data() + pair_first[at(p)] + at(l) * (at(l) + 1) / 2;
      for (int k = 0; k <= l; ++k)
        pair[k] = known[at(entries[entry_first[at(p)] + at(k)].variable)];
    }
    for (const int row : rows) known[at(row)] = -1;
  }
  if (count == poses) lens_offset = block_values;
}

void linearize(const BundleProblem& problem, const BundleVariables& variables,
               const BundleState& state, double curvature, NormalEquations& equations) {
  const std::size_t points = state.points.size();
  equations.blocks.assign(variables.lens_block_offset(variables.block_values), 0.0);
  equations.mixed.assign(variables.mixed_values, 0.0);
  VectorXd& gradient = equations.gradient;
  gradient = VectorXd::Zero(variables.size);
  equations.point_hessian.assign(points, Matrix3d::Zero());
  equations.point_gradient.assign(points, Vector3d::Zero());
  const auto& chosen = problem.free_parameters;
  const auto free = static_cast<Eigen::Index>(chosen.size());
  Vector2d residual;
  Matrix2d factor;
  Matrix2x3 by_position;
  Matrix2x3 by_point;
  Matrix2x6 by_pose;
  Eigen::Matrix<double, 2, 9> by_lens;
  Matrix2xN by_free(2, free);
  for (std::size_t p = 0; p < points; ++p) {
    const bool moves = problem.point_moves[p] != 0;
    for (std::size_t k = problem.first[p]; k < problem.first[p + 1]; ++k) {
      const BundleProblem::Measurement& seen = problem.measurements[k];
      const geometry::Rigid3& pose = state.poses[at(seen.pose)];
      const Vector3d in_camera = pose * state.points[p];
      (void)residual_of(seen, state.lenses[at(seen.lens)], in_camera, residual, &by_position,
                        free > 0 ? &by_lens : nullptr);
      weigh(problem.loss_px, curvature, residual, factor);
      by_position = (factor * by_position).eval();
      by_point.noalias() = by_position * pose.rotation;
      if (moves) {
        equations.point_hessian[p].noalias() += by_point.transpose() * by_point;
        equations.point_gradient[p].noalias() += by_point.transpose() * residual;
      }
      const int l = variables.pose_entry[k];
      if (l >= 0) {
        // A small rotation w after the pose's rotation moves the point in the camera frame by w x
        // in_camera.
        by_pose.col(0) = by_position.col(2) * in_camera[1] - by_position.col(1) * in_camera[2];
        by_pose.col(1) = by_position.col(0) * in_camera[2] - by_position.col(2) * in_camera[0];
        by_pose.col(2) = by_position.col(1) * in_camera[0] - by_position.col(0) * in_camera[1];
        by_pose.rightCols<3>() = -by_point;
        const BundleVariables::Entry& entry = variables.entries[variables.entry_first[p] + at(l)];
        Eigen::Map<Matrix6>(equations.blocks.data() + variables.pose_block_offset(entry.variable))
            .noalias() += by_pose.transpose() * by_pose;
        gradient.segment<6>(variables.offset_of(entry.variable)).noalias() +=
            by_pose.transpose() * residual;
        if (moves)
          Eigen::Map<Matrix6x3>(equations.mixed.data() + entry.offset).noalias() +=
              by_pose.transpose() * by_point;
      }
      const int m = variables.lens_entry[k];
      if (m < 0) continue;
      for (Eigen::Index c = 0; c < free; ++c)
        by_free.col(c) = factor * by_lens.col(chosen[static_cast<std::size_t>(c)]);
      const BundleVariables::Entry& entry = variables.entries[variables.entry_first[p] + at(m)];
      Eigen::Map<MatrixXd>(equations.blocks.data() + variables.lens_block_offset(
                                                         variables.diagonal_offset(entry.variable)),
                           free, free) += by_free.transpose() * by_free;
      gradient.segment(variables.offset_of(entry.variable), free) += by_free.transpose() * residual;
      if (moves)
        Eigen::Map<MatrixNx3>(equations.mixed.data() + entry.offset, free, 3) +=
            by_free.transpose() * by_point;
      if (l >= 0)
        Eigen::Map<MatrixXd>(
            equations.blocks.data() + variables.lens_block_offset(variables.offset_of(p, l, m)), 6,
            free) += by_pose.transpose() * by_free;
    }
  }
  if (problem.prior) {
    const BundleProblem::CenterPrior& prior = *problem.prior;
    const int variable = variables.pose_variable[at(prior.pose)];
    const int number = 3 + prior.axis;
    gradient[variables.offset_of(variable) + number] += prior.weight * prior_residual(prior, state);
    equations.blocks[variables.pose_block_offset(variable) + at(7 * number)] +=
        prior.weight * prior.weight;
  }
  equations.scale = VectorXd(variables.size);
  for (int v = 0; v < variables.count; ++v) {
    const std::size_t diagonal_begin =
        v < variables.poses ? variables.pose_block_offset(v)
                            : variables.lens_block_offset(variables.diagonal_offset(v));
    for (int k = 0; k < variables.size_of(v); ++k)
      equations.scale[variables.offset_of(v) + k] =
          equations.blocks[diagonal_begin + at(k * (variables.size_of(v) + 1))];
  }
}

BundleState moved_by(const BundleProblem& problem, const BundleVariables& variables,
                     const BundleState& now, const BundleStep& step, double share) {
  const VectorXd& moved = step.variables;
  BundleState next = now;
  for (std::size_t i = 0; i < next.poses.size(); ++i) {
    if (variables.pose_variable[i] < 0) continue;
    const Eigen::Index offset = variables.offset_of(variables.pose_variable[i]);
    const geometry::Rigid3& pose = now.poses[i];
    next.poses[i].rotation =
        geometry::rotation_by(share * moved.segment<3>(offset)) * pose.rotation;
    next.poses[i].translation =
        -(next.poses[i].rotation * (pose.center() + share * moved.segment<3>(offset + 3)));
  }
  for (std::size_t i = 0; i < next.lenses.size(); ++i) {
    if (variables.lens_variable[i] < 0) continue;
    for (std::size_t k = 0; k < problem.free_parameters.size(); ++k)
      next.lenses[i][at(problem.free_parameters[k])] +=
          share *
          moved[variables.offset_of(variables.lens_variable[i]) + static_cast<Eigen::Index>(k)];
  }
  for (std::size_t p = 0; p < next.points.size(); ++p) next.points[p] += share * step.points[p];
  return next;
}

bool second_derivative(const BundleProblem& problem, const BundleVariables& variables,
                       const BundleState& now, const BundleStep& step, double curvature,
                       VectorXd& gradient, std::vector<Vector3d>& point_gradient) {
  const BundleState ahead = moved_by(problem, variables, now, step, kSecondOrderShare);
  gradient = VectorXd::Zero(variables.size);
  point_gradient.assign(step.points.size(), Vector3d::Zero());
  Vector2d residual;
  Vector2d later;
  Matrix2d factor;
  Matrix2x3 by_position;
  const auto& chosen = problem.free_parameters;
  const auto free = static_cast<Eigen::Index>(chosen.size());
  Eigen::Matrix<double, 2, 9> by_lens;
  Matrix2xN by_free(2, free);
  for (std::size_t p = 0; p < step.points.size(); ++p) {
    for (std::size_t k = problem.first[p]; k < problem.first[p + 1]; ++k) {
      const BundleProblem::Measurement& seen = problem.measurements[k];
      const geometry::Rigid3& pose = now.poses[at(seen.pose)];
      const Vector3d in_camera = pose * now.points[p];
      const LensParameters& lens = now.lenses[at(seen.lens)];
      (void)residual_of(seen, lens, in_camera, residual, &by_position,
                        free > 0 ? &by_lens : nullptr);
      if (!residual_of(seen, lens, ahead.poses[at(seen.pose)] * ahead.points[p], later, nullptr,
                       nullptr))
        return false;
      Vector3d along = pose.rotation * step.points[p];  // step of the point in the camera frame
      const int variable = variables.pose_variable[at(seen.pose)];
      if (variable >= 0) {
        const auto of_pose = step.variables.segment<6>(variables.offset_of(variable));
        along += Vector3d(of_pose.head<3>()).cross(in_camera) - pose.rotation * of_pose.tail<3>();
      }
      Vector2d first = by_position * along;  // J d
      const int lens_variable = variables.lens_variable[at(seen.lens)];
      if (lens_variable >= 0) {
        for (Eigen::Index c = 0; c < free; ++c)
          by_free.col(c) = by_lens.col(chosen[static_cast<std::size_t>(c)]);
        first += by_free * step.variables.segment(variables.offset_of(lens_variable), free);
      }
      const Vector2d second_order =
          2 / kSecondOrderShare * ((later - residual) / kSecondOrderShare - first);
      weigh(problem.loss_px, curvature, residual, factor);
      const Vector2d weighted = factor.transpose() * (factor * second_order);
      const Vector3d pull = by_position.transpose() * weighted;
      if (problem.point_moves[p] != 0) point_gradient[p] += pose.rotation.transpose() * pull;
      if (lens_variable >= 0)
        gradient.segment(variables.offset_of(lens_variable), free) +=
            by_free.transpose() * weighted;
      if (variable < 0) continue;
      gradient.segment<3>(variables.offset_of(variable)) += in_camera.cross(pull);
      gradient.segment<3>(variables.offset_of(variable) + 3) -= pose.rotation.transpose() * pull;
    }
  }
  return true;
}

}  // namespace tarsier::sfm
