// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/sfm/features/features.h"
#include "tarsier/sfm/features/matching.h"

#include <cstdint>
#include <vector>

// The relative geometry of two images.
namespace tarsier::sfm {

struct TwoViewOptions {
  double threshold_px = 1.5;  // max error of an inlier
  int min_inliers = 20;       // with fewer, the images have no geometry in common
  bool known_focal = true;    // false: inliers are determined by the fundamental matrix
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"threshold_px", threshold_px, range(0.1, 20), "--epipolar-px",
             "maximum epipolar error of an inlier, px"},
            {"min_inliers", min_inliers, range(8, 10000)}};
  }
  void check() const { check_fields(*this); }
};

struct TwoView {
  MatchList inliers;           // of the epipolar geometry; empty: the pair failed
  int homography_inliers = 0;  // inliers that also fit a homography: a plane or a pure rotation
  geometry::Rigid3 second_from_first;  // from the essential matrix; translation of length 1
  int in_front = 0;                    // inliers in front of both cameras
  double median_angle = 0;             // radians, between the rays of those inliers
};

// Estimates the essential matrix, or the fundamental matrix where the focal length is a guess, and
// the homography of the matches (robust_two_view.h), with a seed. Matches must be indices of the
// features. `ratios`: those of match_features(), so that the most reliable matches are tried first;
// empty: unknown.
[[nodiscard]] TwoView verify_pair(const std::vector<cv::Point2f>& first,
                                  const std::vector<cv::Point2f>& second,
                                  const std::vector<Match>& matches, const geometry::Camera& camera,
                                  const geometry::Camera& other, const TwoViewOptions& options,
                                  const std::vector<float>& ratios = {});

// Estimates the motion of a view's inliers again, and what depends on it, with other cameras than
// in the verification. Where no motion is found the view does not change.
void estimate_motion_again(const std::vector<cv::Point2f>& first,
                           const std::vector<cv::Point2f>& second, const geometry::Camera& camera,
                           const geometry::Camera& other, const TwoViewOptions& options,
                           TwoView& view);

// Undistorted pixels, as seen by a pinhole camera with the same matrix.
[[nodiscard]] std::vector<cv::Point2d> undistorted(const std::vector<cv::Point2f>& pixels,
                                                   const geometry::Camera& camera);

}  // namespace tarsier::sfm
