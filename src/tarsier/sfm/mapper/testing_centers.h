// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/rigid3.h"
#include "tarsier/geometry/sim3.h"
#include "tarsier/sfm/scene/model.h"

#include <Eigen/Core>

#include <algorithm>
#include <vector>

namespace tarsier::sfm {

// Largest distance of a registered image's centre from the truth (a pose for each image) after the
// best similarity, as a share of the truth's extent; 1e9 where there is no similarity.
inline double worst_center(const Model& model, const std::vector<geometry::Rigid3>& truth) {
  std::vector<Eigen::Vector3d> from;
  std::vector<Eigen::Vector3d> to;
  for (std::size_t i = 0; i < model.images.size(); ++i) {
    if (!model.images[i].registered) continue;
    from.push_back(model.images[i].pose.center());
    to.push_back(truth[i].center());
  }
  const auto similarity =
      geometry::similarity_between(geometry::columns_of(from), geometry::columns_of(to));
  if (!similarity) return 1e9;
  double worst = 0;
  double extent = 0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    worst = std::max(worst, (*similarity * from[i] - to[i]).norm());
    extent = std::max(extent, (to[i] - to[0]).norm());
  }
  return worst / extent;
}

}  // namespace tarsier::sfm
