// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/tracks.h"
#include "tarsier/sfm/scene/model.h"

namespace tarsier::sfm {

// Whether a model has the two images of a pair, both registered, where the pair says:
//
//   the relative rotation is within 3 degrees of the pair's, and the direction of the translation within 15, where the
//   rays of the pair differ by 2 degrees or more;
//
//   or one plane explains 0.7 of the pair's inliers, and a plane seen from the model's two poses does so within 4 px.
//   Images of a plane have two relative poses (Longuet-Higgins, The reconstruction of a plane surface from two
//   perspective projections, Proc. R. Soc. B 1986), of which the pair knows one. With the model's rotation R and
//   translation t, the plane n'x = 1 takes the ray x of the first image to (R + t n') x; n is the best one for the
//   inliers.
[[nodiscard]] bool agrees(const Model& model, const Pair& pair);

}  // namespace tarsier::sfm
