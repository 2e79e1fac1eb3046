// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/sfm/dense/workspace.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <nlohmann/json_fwd.hpp>
#include <vector>

// The true surface for evaluations.
namespace tarsier::sfm {

// A true depth map and its camera.
struct GroundTruthView {
  cv::Mat1f depth;          // 0: unknown
  geometry::Camera camera;  // of the map
  geometry::Rigid3 pose;    // camera_from_world

  [[nodiscard]] Eigen::Vector3d world_of(int x, int y) const;
  // Whether the depth at the pixel of `world` is that of `world`, within 1 %.
  [[nodiscard]] bool sees(const Eigen::Vector3d& world) const;
};
// The view of image `index`. Throws InputError (no depth map).
[[nodiscard]] GroundTruthView ground_truth_view(const Workspace& workspace, int index);

// Scores of a surface at one distance threshold.
struct ThresholdScore {
  double threshold = 0;     // share of the extent
  double accuracy = 0;      // share of the points within this distance of the true surface
  double completeness = 0;  // share of the true surface within this distance of a point
  double f1 = 0;            // harmonic mean of both
};
// Scores at 0.25, 0.5 and 1 % of `extent`. `accuracy_distances`: distances of the surface's points
// from the true surface, `completeness_distances`: distances of the true points from the surface.
// Both may be clamped at distance_limit().
[[nodiscard]] std::vector<ThresholdScore> score_thresholds(
    const std::vector<float>& accuracy_distances, const std::vector<float>& completeness_distances,
    double extent);
// World units, slightly above the largest threshold: larger distances need not be exact.
[[nodiscard]] float distance_limit(double extent);
// World units, the smallest threshold: the cell size of a grid for these distances.
[[nodiscard]] float distance_cell(double extent);
// [{"threshold", "accuracy", "completeness", "f1"}]
[[nodiscard]] nlohmann::ordered_json to_json(const std::vector<ThresholdScore>& scores);

// Share of the values up to `limit`; 0 without values.
[[nodiscard]] double share_within(const std::vector<float>& values, double limit);

// Diagonal of the bounding box of the points, without the outer 0.5 % on each side of each axis.
[[nodiscard]] double extent_of(const std::vector<cv::Vec3f>& points);

}  // namespace tarsier::sfm
