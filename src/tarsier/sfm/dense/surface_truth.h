// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/sfm/dense/workspace.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <nlohmann/json_fwd.hpp>
#include <vector>

// What evaluations know of the true surface.
namespace tarsier::sfm {

// A depth map of the truth and where it was taken from.
struct TrueView {
  cv::Mat1f depth;          // 0: not known
  geometry::Camera camera;  // of the map
  geometry::Rigid3 pose;    // camera from world

  [[nodiscard]] Eigen::Vector3d world_of(int x, int y) const;
  // The pixel that `world` falls on has its depth, to 1 %.
  [[nodiscard]] bool sees(const Eigen::Vector3d& world) const;
};
// Of image `index`. Throws InputError (no depth map).
[[nodiscard]] TrueView true_view(const Workspace& workspace, int index);

// How near a surface is to the true one, at one distance.
struct ThresholdScore {
  double threshold = 0;     // of the extent
  double accuracy = 0;      // share of the points that are so near to the true surface
  double completeness = 0;  // share of the true surface that is so near to a point
  double f1 = 0;            // their harmonic mean
};
// At 0.25, 0.5 and 1 % of `extent`. `off`: distances of the surface's points from the true one,
// `missing`: of the true one's points from the surface; both may be
// cut at distance_limit().
[[nodiscard]] std::vector<ThresholdScore> score_thresholds(const std::vector<float>& off,
                                                           const std::vector<float>& missing,
                                                           double extent);
// World units, just beyond the largest threshold: longer distances need not be known.
[[nodiscard]] float distance_limit(double extent);
// World units, the smallest threshold: the cells of a grid for these distances.
[[nodiscard]] float distance_cell(double extent);
// [{"threshold", "accuracy", "completeness", "f1"}]
[[nodiscard]] nlohmann::ordered_json to_json(const std::vector<ThresholdScore>& scores);

// Share of the values that are `limit` or less; 0 of none.
[[nodiscard]] double share_within(const std::vector<float>& values, double limit);

// Diagonal of the box around the points, without the outer 0.5 % on each side of each axis.
[[nodiscard]] double extent_of(const std::vector<cv::Vec3f>& points);

}  // namespace tarsier::sfm
