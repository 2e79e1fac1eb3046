// SPDX-License-Identifier: MIT
#include "tarsier/sfm/joining/model_groups.h"

#include "tarsier/core/angles.h"
#include "tarsier/core/at.h"
#include "tarsier/linalg/decompositions.h"
#include "tarsier/sfm/global/rotation_averaging.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <numeric>
#include <utility>

namespace tarsier::sfm {
namespace {

using geometry::Sim3;

// The diagonal of the bounding box of centres.
double extent_of(const std::vector<Eigen::Vector3d>& centers) {
  if (centers.empty()) return 0;
  Eigen::Vector3d low = centers.front();
  Eigen::Vector3d high = centers.front();
  for (const Eigen::Vector3d& center : centers) {
    low = low.cwiseMin(center);
    high = high.cwiseMax(center);
  }
  return (high - low).norm();
}

}  // namespace

double extent_of(const Model& model) {
  std::vector<Eigen::Vector3d> centers;
  for (const Image& image : model.images)
    if (image.registered) centers.push_back(image.pose.center());
  return extent_of(centers);
}

int registered_count(const Model& model) {
  return static_cast<int>(std::count_if(model.images.begin(), model.images.end(),
                                        [](const Image& image) { return image.registered; }));
}

ModelGroups::ModelGroups(const std::vector<Model>& models, std::vector<ModelJoin>& joins)
    : models_(models), joins_(joins), group_(models.size()), world_from_model_(models.size()) {
  std::iota(group_.begin(), group_.end(), 0);
}

void ModelGroups::run(const std::stop_token& stop) {
  std::vector<std::size_t> order(joins_.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return joins_[a].inliers > joins_[b].inliers;
  });
  std::vector<char> has_cycle(models_.size(), 0);  // per group, stored at its first model
  for (const std::size_t k : order) {
    ModelJoin& join = joins_[k];
    if (!join.refusal.empty()) continue;
    const int a = group_[at(join.first)];
    const int b = group_[at(join.second)];
    if (a != b) {
      merge(join, a, b);
      if (has_cycle[at(std::max(a, b))] != 0) has_cycle[at(std::min(a, b))] = 1;
    } else if (join.refusal = contradiction_of(join); join.refusal.empty()) {
      has_cycle[at(a)] = 1;
    }
  }
  for (std::size_t g = 0; g < models_.size(); ++g)
    if (has_cycle[g] != 0 && group_[g] == static_cast<int>(g)) average(static_cast<int>(g), stop);
}

std::vector<std::vector<int>> ModelGroups::members() const {
  std::map<int, std::vector<int>> by_group;
  for (std::size_t m = 0; m < group_.size(); ++m)
    by_group[group_[m]].push_back(static_cast<int>(m));
  std::vector<std::vector<int>> result;
  for (auto& [group, all] : by_group) {
    std::stable_sort(all.begin(), all.end(), [&](int a, int b) {
      return registered_count(models_[at(a)]) > registered_count(models_[at(b)]);
    });
    result.push_back(std::move(all));
  }
  return result;
}

Sim3 ModelGroups::root_from_model(int model, int root) const {
  return world_from_model_[at(root)].inverse() * world_from_model_[at(model)];
}

void ModelGroups::merge(const ModelJoin& join, int a, int b) {
  // Moves the second group so that world_from_second = world_from_first * first_from_second.
  const Sim3 move = world_from_model_[at(join.first)] * join.first_from_second *
                    world_from_model_[at(join.second)].inverse();
  const int merged_group = std::min(a, b);
  for (std::size_t m = 0; m < group_.size(); ++m) {
    if (group_[m] == b) world_from_model_[m] = move * world_from_model_[m];
    if (group_[m] == a || group_[m] == b) group_[m] = merged_group;
  }
}

std::string ModelGroups::contradiction_of(const ModelJoin& join) const {
  const Sim3 predicted =
      world_from_model_[at(join.first)].inverse() * world_from_model_[at(join.second)];
  const Sim3& measured = join.first_from_second;
  const double angle =
      geometry::angle_of(predicted.rotation.transpose() * measured.rotation) * kDegreesPerRadian;
  const double scale = std::abs(std::log(predicted.scale / measured.scale));
  double distance = 0;
  double count = 0;
  std::vector<Eigen::Vector3d> centers;
  for (std::size_t m = 0; m < models_.size(); ++m) {
    if (group_[m] != group_[at(join.first)]) continue;
    const Sim3 to_first = world_from_model_[at(join.first)].inverse() * world_from_model_[m];
    for (const Image& image : models_[m].images)
      if (image.registered) centers.push_back(to_first * image.pose.center());
  }
  for (std::size_t i = 0; i < models_.front().images.size(); ++i) {
    const Image& a = models_[at(join.first)].images[i];
    const Image& b = models_[at(join.second)].images[i];
    if (!a.registered || !b.registered) continue;
    distance += (predicted * b.pose.center() - measured * b.pose.center()).norm();
    count += 1;
  }
  const double share = distance / count / std::max(1e-300, extent_of(centers));
  if (angle <= kMaxLoopDeg && scale <= kMaxLoopLogScale && share <= kMaxLoopShare) return {};
  return fmt::format(
      "it contradicts joins with more common points: the rotations differ by {:.1f} degrees, the "
      "scales by a factor of {:.2f}, the positions by {:.1f} % of the extent",
      angle, std::exp(scale), 100 * share);
}

void ModelGroups::average(int group, const std::stop_token& stop) {
  std::vector<int> members;
  std::vector<int> index(models_.size(), -1);
  for (std::size_t m = 0; m < group_.size(); ++m) {
    if (group_[m] != group) continue;
    index[m] = static_cast<int>(members.size());
    members.push_back(static_cast<int>(m));
  }
  std::vector<const ModelJoin*> joins;
  std::vector<RelativeRotation> rotations;
  for (const ModelJoin& join : joins_) {
    if (!join.refusal.empty() || index[at(join.first)] < 0) continue;
    joins.push_back(&join);
    rotations.push_back({index[at(join.first)], index[at(join.second)],
                         join.first_from_second.rotation.transpose(),
                         static_cast<double>(join.inliers)});
  }
  const auto count = static_cast<int>(members.size());
  const AveragedRotations averaged = average_rotations(count, rotations, {}, stop);
  // In the frame of the first member.
  const Sim3 anchor = world_from_model_[at(members.front())];
  std::vector<Sim3> averaged_transforms(members.size());
  for (std::size_t m = 0; m < members.size(); ++m)
    averaged_transforms[m].rotation = averaged.rotations[m].transpose();
  // Unknowns of all members but the first, which is fixed at 0.
  Eigen::MatrixXd laplacian = Eigen::MatrixXd::Zero(count, count);
  const auto solve = [&](const auto& difference, int columns) {
    laplacian.setZero();
    Eigen::MatrixXd right = Eigen::MatrixXd::Zero(count, columns);
    for (const ModelJoin* join : joins) {
      const int a = index[at(join->first)];
      const int b = index[at(join->second)];
      const double weight = join->inliers;
      const Eigen::RowVectorXd step = weight * difference(*join, a);
      laplacian(a, a) += weight;
      laplacian(b, b) += weight;
      laplacian(a, b) -= weight;
      laplacian(b, a) -= weight;
      right.row(a) -= step;
      right.row(b) += step;
    }
    Eigen::MatrixXd result = Eigen::MatrixXd::Zero(count, columns);
    result.bottomRows(count - 1) = linalg::solve_symmetric(
        laplacian.bottomRightCorner(count - 1, count - 1), right.bottomRows(count - 1));
    return result;
  };
  const Eigen::MatrixXd scales = solve(
      [](const ModelJoin& join, int) -> Eigen::RowVectorXd {
        return Eigen::RowVectorXd::Constant(1, std::log(join.first_from_second.scale));
      },
      1);
  for (std::size_t m = 0; m < members.size(); ++m)
    averaged_transforms[m].scale = std::exp(scales(static_cast<Eigen::Index>(m), 0));
  const Eigen::MatrixXd offsets = solve(
      [&](const ModelJoin& join, int a) -> Eigen::RowVectorXd {
        return (averaged_transforms[at(a)].scale *
                (averaged_transforms[at(a)].rotation * join.first_from_second.translation))
            .transpose();
      },
      3);
  for (std::size_t m = 0; m < members.size(); ++m) {
    averaged_transforms[m].translation = offsets.row(static_cast<Eigen::Index>(m)).transpose();
    world_from_model_[at(members[m])] = anchor * averaged_transforms[m];
  }
}

}  // namespace tarsier::sfm
