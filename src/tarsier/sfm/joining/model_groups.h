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

// Max deviation by drift of a join that closes a cycle: degrees, logarithm of the scale, and share
// of the extent.
constexpr double kMaxLoopDeg = 10;
constexpr double kMaxLoopLogScale = 0.25;
constexpr double kMaxLoopShare = 0.1;

// The diagonal of the bounding box of registered centres.
[[nodiscard]] double extent_of(const Model& model);
// Number of registered images.
[[nodiscard]] int registered_count(const Model& model);

// Determines which models become one, and the place of each; see join_models(). Both arguments must
// outlive this object.
class ModelGroups {
 public:
  ModelGroups(const std::vector<Model>& models, std::vector<ModelJoin>& joins);
  // Sets a refusal for joins that contradict the others. Throws Interrupted.
  void run(const std::stop_token& stop);
  // Models of each group, the one with most images first; its frame is the frame of the group.
  [[nodiscard]] std::vector<std::vector<int>> members() const;
  // The transform into the frame of `root`, a model of the same group.
  [[nodiscard]] geometry::Sim3 root_from_model(int model, int root) const;

 private:
  void merge(const ModelJoin& join, int a, int b);
  // The difference between a join and the places of its models by other joins; "" where they agree.
  [[nodiscard]] std::string contradiction_of(const ModelJoin& join) const;
  // Distributes the errors of cycles.
  void average(int group, const std::stop_token& stop);

  const std::vector<Model>& models_;
  std::vector<ModelJoin>& joins_;
  std::vector<int> group_;
  std::vector<geometry::Sim3> world_from_model_;  // in the world of the group
};

}  // namespace tarsier::sfm
