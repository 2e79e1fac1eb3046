// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/rigid3.h"
#include "tarsier/sfm/bundle/bundle_solver.h"

#include <Eigen/Core>
#include <opencv2/core/utility.hpp>

#include <cstddef>
#include <vector>

// Internal to bundle adjustment: the cost function, and steps of single points.
namespace tarsier::sfm {

// The variables of the adjustment.
struct BundleState {
  std::vector<geometry::Rigid3> poses;
  std::vector<LensParameters> lenses;
  std::vector<Eigen::Vector3d> points;
};

// Calls `each` for each point, on several threads where there are many.
template <typename Each>
void for_each_point(const BundleProblem& problem, const Each& each) {
  constexpr int kMany = 10'000;
  const cv::Range all(0, static_cast<int>(problem.points.size()));
  const auto body = [&](const cv::Range& range) {
    for (int p = range.start; p < range.end; ++p) each(static_cast<std::size_t>(p));
  };
  if (all.size() < kMany) {
    body(all);
  } else {
    cv::parallel_for_(all, body);
  }
}

// The cost for each point. It is infinite where the point is behind a camera that shows it, or
// where a number is not finite.
struct BundleCosts {
  std::vector<double> point_costs;
  double prior = 0;

  [[nodiscard]] double sum() const;
};
BundleCosts costs_of(const BundleProblem& problem, const BundleState& state);

// Refines single points with fixed cameras: moving points whose cost a step has raised, from
// `before` to `after` (embedded point iterations: Jeong et al., Pushing the envelope of modern
// methods for bundle adjustment, PAMI 2012). Otherwise a single point that a step moves behind a
// camera would make the whole step fail. `costs`: those of `after`, updated. Does not depend on the
// number of threads.
void refine_raised_points(const BundleProblem& problem, const BundleState& before,
                          const BundleCosts& costs_before, BundleState& after, BundleCosts& costs);

}  // namespace tarsier::sfm
