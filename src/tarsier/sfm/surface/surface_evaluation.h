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

// Accuracy of a surface, compared with the true one.
struct SurfaceScores {
  double extent = 0;  // world units of the truth: diagonal of the bounding box of the compared part
  // world units of the truth: from the surface's points to the true surface
  double distance_median = 0;
  std::vector<ThresholdScore> thresholds;
  // The surface with its vertices blue where they are on the true one, to red at 1 % of the extent.
  SurfaceMesh errors;
};
// {"extent", "distance_median", "thresholds": [{"threshold", "accuracy", "completeness", "f1"}]}
[[nodiscard]] nlohmann::ordered_json to_json(const SurfaceScores& scores);

// Points on the surface, uniform over its area, in the order of the faces, one per spacing².
// Deterministic. Throws std::invalid_argument unless spacing > 0.
[[nodiscard]] std::vector<cv::Vec3f> sample_surface(const SurfaceMesh& mesh, double spacing);

// Accuracy: distances from points on `surface` to `truth`, as Knapitsch and others define it for
// clouds ("Tanks and Temples", SIGGRAPH 2017). Completeness: distances to `surface` from points on
// `truth` that two images of `cameras` see, by their true depth maps. `truth_from_model` transforms
// the surface to the truth. Throws InputError (no point that two images see), std::invalid_argument
// (a mesh without faces), Interrupted.
[[nodiscard]] SurfaceScores evaluate_surface(const Workspace& cameras, const SurfaceMesh& truth,
                                             const SurfaceMesh& surface,
                                             const geometry::Sim3& truth_from_model,
                                             Progress& progress, const std::stop_token& stop);

}  // namespace tarsier::sfm
