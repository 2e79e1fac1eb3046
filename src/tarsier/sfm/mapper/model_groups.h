// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/sim3.h"
#include "tarsier/sfm/mapper/model_join.h"
#include "tarsier/sfm/scene/model.h"

#include <Eigen/Core>

#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::sfm {

// A join that closes a cycle must agree with the others as far as drift goes: degrees, the logarithm of the scale, and a
// share of the extent.
constexpr double kMaxOpenDeg = 10;
constexpr double kMaxOpenScale = 0.25;
constexpr double kMaxOpenShare = 0.1;

// The diagonal of the box around the centres of registered images.
[[nodiscard]] double extent_of(const Model& model);
// Registered images.
[[nodiscard]] int registered_of(const Model& model);

// Which models become one, and where each lies in it: join_models() says how. Both arguments must outlive it.
class ModelGroups {
 public:
  ModelGroups(const std::vector<Model>& models, std::vector<ModelJoin>& joins);
  // Joins that contradict the others get a refusal. Throws Interrupted.
  void run(const std::stop_token& stop);
  // Models of each group, the one with most images first; its frame is that of the group.
  [[nodiscard]] std::vector<std::vector<int>> members() const;
  // Into the frame of `root`, of the same group.
  [[nodiscard]] geometry::Sim3 place(int model, int root) const;

 private:
  void unite(const ModelJoin& join, int a, int b);
  // Between what a join says and where the two models lie by other joins; "" where they agree.
  [[nodiscard]] std::string why_open(const ModelJoin& join) const;
  // Spreads what cycles leave open.
  void average(int group, const std::stop_token& stop);

  const std::vector<Model>& models_;
  std::vector<ModelJoin>& joins_;
  std::vector<int> group_;
  std::vector<geometry::Sim3> place_;  // world_from_model, of the group's world
};

}  // namespace tarsier::sfm
