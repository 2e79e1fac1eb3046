// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/rigid3.h"

#include <Eigen/Core>

#include <cstdint>
#include <span>
#include <vector>

// Essential matrices, fundamental matrices and homographies of two sets of points of which many do
// not belong together: samples as small as possible (geometry/epipolar.h), the best ones first
// (PROSAC: Chum and Matas, CVPR 2005) where it is known how good they are; a model counts by the
// truncated squared errors of all (MSAC: Torr and Zisserman, CVIU 2000), and each that is better than
// all before is refined on its inliers (Chum, Matas and Kittler, DAGM 2003).
namespace tarsier::sfm {

struct RobustOptions {
  double threshold = 1;  // of an inlier: Sampson's distance, or that of the second image's points
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
  // Indices of the pairs, the likeliest to be right first; empty: not known.
  std::vector<int> order;
};

struct RobustMatrix {
  Eigen::Matrix3d matrix = Eigen::Matrix3d::Zero();
  std::vector<char> is_inlier;  // of each pair; empty: nothing was found
  int inliers = 0;
};

struct RobustMotion {
  geometry::Rigid3 second_from_first;  // translation of length 1
  std::vector<char> is_inlier;
  int inliers = 0;
};

// Normalised coordinates. The motion is the one of four for which most inliers lie before both
// cameras. Refined by Gauss and Newton's method on Sampson's distances of the inliers.
[[nodiscard]] RobustMotion robust_motion(const PointPairs& pairs, const RobustOptions& options);

struct RefinedMotion {
  geometry::Rigid3 second_from_first;  // translation of length 1
  double cost = 0;  // sum of log(1 + d^2 / (threshold / 2)^2), d: Sampson's distance
};

// A motion refined on all pairs, in normalised coordinates, by so many steps of Gauss and Newton's method at most; a step
// that costs more is not taken.
[[nodiscard]] RefinedMotion refine_motion(const PointPairs& pairs, const geometry::Rigid3& start,
                                          double threshold, int max_steps);

// Pixels, or any other unit.
[[nodiscard]] RobustMatrix robust_fundamental(const PointPairs& pairs,
                                              const RobustOptions& options);
[[nodiscard]] RobustMatrix robust_homography(const PointPairs& pairs, const RobustOptions& options);

}  // namespace tarsier::sfm
