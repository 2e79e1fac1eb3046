// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/geometry/sim3.h"
#include "tarsier/sfm/dense/surface_truth.h"
#include "tarsier/sfm/dense/workspace.h"
#include "tarsier/sfm/surface/surface_mesh.h"

#include <opencv2/core.hpp>

#include <nlohmann/json_fwd.hpp>
#include <stop_token>
#include <vector>

namespace tarsier::sfm {

// How good a surface is, where the true one is known.
struct SurfaceScores {
  double extent = 0;  // world units of the truth: diagonal of the box around what is compared
  double distance_median =
      0;  // world units of the truth: of the surface's points from the true one
  std::vector<ThresholdScore> thresholds;
  SurfaceMesh
      errors;  // the surface, its vertices blue where they are on the true one, red from 1 % of the extent on
};
// {"extent", "distance_median", "thresholds": [{"threshold", "accuracy", "completeness", "f1"}]}
[[nodiscard]] nlohmann::ordered_json to_json(const SurfaceScores& scores);

// Points on the surface, evenly over its area in the order of the faces, one for each spacing²; the
// same points for the same mesh. Throws std::invalid_argument unless spacing > 0.
[[nodiscard]] std::vector<cv::Vec3f> sample_surface(const SurfaceMesh& mesh, double spacing);

// Accuracy: of points on `surface` the distance to `truth`, as Knapitsch and others have it for
// clouds ("Tanks and Temples", SIGGRAPH 2017). Completeness: of points on `truth` that two images
// of `cameras` see (their true depth maps) the distance to `surface`. `truth_from_model` brings the
// surface to the truth. Throws InputError (nothing that two images see), std::invalid_argument (a
// mesh without faces), Interrupted.
[[nodiscard]] SurfaceScores evaluate_surface(const Workspace& cameras, const SurfaceMesh& truth,
                                             const SurfaceMesh& surface,
                                             const geometry::Sim3& truth_from_model,
                                             Progress& progress, const std::stop_token& stop);

}  // namespace tarsier::sfm
