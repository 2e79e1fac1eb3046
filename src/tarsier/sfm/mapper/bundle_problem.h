// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/bundle.h"
#include "tarsier/sfm/mapper/bundle_solver.h"
#include "tarsier/sfm/scene/model.h"

#include <vector>

// The inside of the bundle adjustment: what of a model takes part, as numbers.
namespace tarsier::sfm {

struct ModelProblem {
  BundleProblem problem;
  // Indices into the model: of the problem's poses, ascending; of its lenses; and of its points.
  std::vector<int> images;
  std::vector<int> cameras;
  std::vector<int> points;
};

// The adjustment that `options` ask for. Observations of large features count less, as they are not located as well. Where
// no image stays as it is, the first one does, and the distance to the one farthest from it keeps the scale. No points where
// nothing is to be adjusted.
[[nodiscard]] ModelProblem problem_of(const Model& model, const BundleOptions& options);

// The numbers of a pinhole camera.
[[nodiscard]] LensNumbers numbers_of(const geometry::Camera& camera);

}  // namespace tarsier::sfm
