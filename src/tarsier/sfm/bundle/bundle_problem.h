// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/bundle/bundle.h"
#include "tarsier/sfm/bundle/bundle_solver.h"
#include "tarsier/sfm/scene/model.h"

#include <vector>

// Internal to bundle adjustment: selects the parts of a model that are adjusted.
namespace tarsier::sfm {

struct ModelProblem {
  BundleProblem problem;
  // Indices into the model: the problem's poses, ascending; its lenses; and its points.
  std::vector<int> images;
  std::vector<int> cameras;
  std::vector<int> points;
};

// The adjustment that `options` request. Observations of large features get less weight, as their
// position is less accurate. Where no image is fixed, the first one is, and its distance to the
// farthest image fixes the scale. Has no points where nothing is to be adjusted.
[[nodiscard]] ModelProblem problem_of(const Model& model, const BundleOptions& options);

// The parameters of a pinhole camera.
[[nodiscard]] LensParameters lens_parameters_of(const geometry::Camera& camera);

}  // namespace tarsier::sfm
