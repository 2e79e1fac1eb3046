// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/sfm/mapper/tracks.h"
#include "tarsier/sfm/scene/model.h"

#include <stop_token>
#include <vector>

// Focal lengths of lenses that are not known, before anything is mapped (self-calibration). The inliers of a pair fit
// the essential matrix of the true focal length better than those of others. With the focal length of all unknown lenses
// times a factor g, the pair's cost is
//
//   c(g) = min over R, t of sum over inliers of log(1 + d^2 / (t/2)^2),
//
// d Sampson's distance in px and t the threshold of an inlier. Pairs of one plane, and of cameras that turn about one point
// that all of them face, leave c flat and say nothing; others outvote them. The sum over pairs is minimised, as Sweeney and
// others (Optimizing the viewing graph for structure-from-motion, ICCV 2015) do with an algebraic cost of the fundamental
// matrices.
namespace tarsier::sfm {

struct FocalEstimate {
  int camera = 0;
  double focal_px = 0;
  double spread =
      0;  // standard deviation of the logarithm of the focal length, by leaving out fifths of the pairs
  int pairs = 0;  // that it is of
};

// Of each camera of which `is_guess` is true and whose pairs tell it: from 5 pairs on, within a third of the guess and
// three times it, the spread at most 0.1. A camera without such pairs of its own takes the factor of all pairs together,
// where these agree on one. Guessed cameras are taken as they are but for their focal length. `threshold_px`: of the pairs'
// inliers. Throws Interrupted.
[[nodiscard]] std::vector<FocalEstimate> estimate_focal_lengths(
    const std::vector<geometry::Camera>& cameras, const std::vector<char>& is_guess,
    const std::vector<Image>& images, const std::vector<Pair>& pairs, double threshold_px,
    const std::stop_token& stop);

}  // namespace tarsier::sfm
