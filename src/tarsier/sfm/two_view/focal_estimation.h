// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <stop_token>
#include <vector>

// Estimates unknown focal lengths before mapping (self-calibration). The inliers of a pair fit the
// essential matrix of the true focal length better than that of others. Let all unknown focal
// lengths be multiplied by a factor g. The cost of a pair is then
//
//   c(g) = min over R, t of sum over inliers of log(1 + d^2 / (t/2)^2),
//
// with Sampson's distance d in px and the inlier threshold t. For pairs of one plane, and of
// cameras that rotate around a point which all of them face, c is flat; other pairs outvote them.
// The sum over pairs is minimised, as Sweeney and others (Optimizing the viewing graph for
// structure-from-motion, ICCV 2015) do with an algebraic cost of the fundamental matrices.
namespace tarsier::sfm {

struct FocalEstimate {
  int camera = 0;
  double focal_px = 0;
  // standard deviation of the logarithm of the focal length, by leaving out fifths of the pairs
  double spread = 0;
  int pairs = 0;  // number of pairs used
};

// Estimates each camera with `is_guess` whose pairs determine it: at least 5 pairs, a result
// between a third and three times the guess, and a spread of at most 0.1. A guessed camera without
// such pairs of its own takes the common factor of all pairs, where these agree on one. Other
// parameters of guessed cameras are not changed. `threshold_px`: of the pairs' inliers. Throws
// Interrupted.
[[nodiscard]] std::vector<FocalEstimate> estimate_focal_lengths(
    const std::vector<geometry::Camera>& cameras, const std::vector<char>& is_guess,
    const std::vector<Image>& images, const std::vector<Pair>& pairs, double threshold_px,
    const std::stop_token& stop);

}  // namespace tarsier::sfm
