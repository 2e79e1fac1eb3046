// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/rigid3.h"

#include <Eigen/Core>

#include <cstdint>
#include <span>
#include <vector>

// Essential matrices, fundamental matrices and homographies of correspondences with many outliers.
// Minimal samples (geometry/epipolar.h) are drawn, the best first where a ranking is known (PROSAC:
// Chum and Matas, CVPR 2005). Models are scored by the truncated squared errors of all pairs (MSAC:
// Torr and Zisserman, CVIU 2000). Each new best model is refined on its inliers (Chum, Matas and
// Kittler, DAGM 2003).
namespace tarsier::sfm {

struct RobustOptions {
  // Max error of an inlier: Sampson's distance, or for homographies the distance in the second
  // image.
  double threshold = 1;
  double confidence = 0.9999;  // that no better model is missed
  int max_samples = 2000;
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"threshold", threshold, above(0)},
            {"confidence", confidence, inside(0, 1)},
            {"max_samples", max_samples, at_least(1)}};
  }
  void check() const { check_fields(*this); }
};

struct PointPairs {
  std::vector<Eigen::Vector2d> first;
  std::vector<Eigen::Vector2d> second;
  // Indices of the pairs, the most reliable first; empty: unknown.
  std::vector<int> order;
};

struct RobustMatrix {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Zero();
  std::vector<char> is_inlier;  // for each pair; empty: nothing was found
  int inliers = 0;
};

struct RobustMotion {
  geometry::Rigid3 second_from_first;  // translation of length 1
  std::vector<char> is_inlier;
  int inliers = 0;
};

// Normalised coordinates. Of four motions, the one with most inliers in front of both cameras is
// taken. It is refined by Gauss-Newton on Sampson's distances of the inliers.
[[nodiscard]] RobustMotion robust_motion(const PointPairs& pairs, const RobustOptions& options);

struct RefinedMotion {
  geometry::Rigid3 second_from_first;  // translation of length 1
  double cost = 0;  // sum of log(1 + d^2 / (threshold / 2)^2), d: Sampson's distance
};

// Refines a motion on all pairs, in normalised coordinates, by at most `max_steps` Gauss-Newton
// steps. A step that raises the cost is not taken.
[[nodiscard]] RefinedMotion refine_motion(const PointPairs& pairs, const geometry::Rigid3& start,
                                          double threshold, int max_steps);

// Pixels, or any other unit.
[[nodiscard]] RobustMatrix robust_fundamental(const PointPairs& pairs,
                                              const RobustOptions& options);
[[nodiscard]] RobustMatrix robust_homography(const PointPairs& pairs, const RobustOptions& options);

}  // namespace tarsier::sfm
