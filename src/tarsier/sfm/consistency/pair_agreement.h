// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <cstddef>

namespace tarsier::sfm {

// Whether a model agrees with the relative pose of a pair of registered images. It agrees where one
// of these holds:
// - The relative rotation is within 3 degrees of the pair's, and the direction of the translation
//   within 15 degrees, where the rays of the pair differ by 2 degrees or more.
// - The model's poses explain 0.9 of the pair's inliers within 2 px (explained_matches()). A small
//   and distant scene leaves the relative pose uncertain, but not the epipolar lines: more rotation
//   and less relief look nearly the same (Szeliski and Kang, Shape ambiguities in structure from
//   motion, PAMI 1997), and the pair knows only one such pose.
// - A homography explains 0.7 of the pair's inliers, and a plane seen from the model's two poses
//   does so within 4 px. Images of a plane have two relative poses (Longuet-Higgins, The
//   reconstruction of a plane surface from two perspective projections, Proc. R. Soc. B 1986), of
//   which the pair knows only one. With the model's rotation R and translation t, the plane n'x = 1
//   maps the ray x of the first image to (R + t n') x; n is the best one for the inliers.
[[nodiscard]] bool agrees(const Model& model, const Pair& pair);

// Whether the pair is verified and the model has both of its images.
[[nodiscard]] bool is_registered(const Model& model, const Pair& pair);

// Number of the pair's inliers that the model's two poses explain: within `threshold_px` of their
// epipolar lines (Sampson's distance; Hartley and Zisserman, Multiple view geometry, 2nd edition,
// 11.4.3), and in front of both cameras.
[[nodiscard]] std::size_t explained_matches(const Model& model, const Pair& pair,
                                            double threshold_px);

}  // namespace tarsier::sfm
