// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/sfm/mapper/features.h"
#include "tarsier/sfm/mapper/matching.h"

#include <cstdint>
#include <vector>

// What two images say about each other.
namespace tarsier::sfm {

struct TwoViewOptions {
  double threshold_px = 1.5;  // of an inlier
  int min_inliers = 20;       // below it the images have nothing in common
  bool known_focal = true;    // false: the fundamental matrix decides what is an inlier
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"threshold_px", threshold_px, range(0.1, 20), "--epipolar-px", "of an inlier"},
            {"min_inliers", min_inliers, range(8, 10000)}};
  }
  void check() const { check_fields(*this); }
};

struct TwoView {
  MatchList inliers;                   // of the epipolar geometry; empty: the pair failed
  int homography_inliers = 0;          // how many of these one plane (or a mere rotation) explains
  geometry::Rigid3 second_from_first;  // translation of length 1; of the essential matrix
  int in_front = 0;                    // inliers in front of both cameras
  double median_angle = 0;             // radians, between the rays of those
};

// The essential matrix, or the fundamental matrix where the focal length is a guess, and the
// homography of the matches (robust_two_view.h), seeded. Matches must fit the features. `ratios`: of
// each match as of match_features(), so that the surest are tried first; empty: not known.
[[nodiscard]] TwoView verify_pair(const std::vector<cv::Point2f>& first,
                                  const std::vector<cv::Point2f>& second,
                                  const std::vector<Match>& matches, const geometry::Camera& camera,
                                  const geometry::Camera& other, const TwoViewOptions& options,
                                  const std::vector<float>& ratios = {});

// The motion of a view's inliers again, and what follows from it, with other cameras than it was verified with. A view in
// which none is found stays as it is.
void estimate_motion_again(const std::vector<cv::Point2f>& first,
                           const std::vector<cv::Point2f>& second, const geometry::Camera& camera,
                           const geometry::Camera& other, const TwoViewOptions& options,
                           TwoView& view);

// Pixels without the lens's distortion, as a pinhole of the same matrix would see them.
[[nodiscard]] std::vector<cv::Point2d> undistorted(const std::vector<cv::Point2f>& pixels,
                                                   const geometry::Camera& camera);

}  // namespace tarsier::sfm
