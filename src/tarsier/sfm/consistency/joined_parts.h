// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <vector>

namespace tarsier::sfm {

// Whether `whole` has the models of `parts` joined to fewer models, by pairs that no stronger pair
// contradicts. Models of all images contradict more pairs than their parts do, because parts of a
// scene that repeats look alike; so their trust cannot decide between them. All of these hold:
// - A model of `whole` has 0.95 of the images of each part of five images or more, and the part has
//   the same shape there: a similarity moves 0.95 of its images by at most 1 % of its extent, and
//   turns them by at most 3 degrees.
// - Pairs between different parts that agree with the whole (pair_agreement.h) connect all parts of
//   one model. No contradicted pair of 30 inliers or more between two parts is stronger than the
//   weakest of the agreeing pairs that connect these two (strength_of()).
[[nodiscard]] bool joins_parts(const std::vector<Model>& whole, const std::vector<Model>& parts,
                               const std::vector<Pair>& pairs);

}  // namespace tarsier::sfm
