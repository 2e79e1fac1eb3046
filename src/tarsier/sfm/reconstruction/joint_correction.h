// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/reconstruction.h"
#include "tarsier/sfm/reconstruction/strong_pairs.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <vector>

namespace tarsier::sfm {

// Corrects wrong joints of models of scenes that repeat, where wrong pairs join two parts that are
// right. The images are mapped again with the pairs that agree with the models, except those that
// make the joint:
// - A joint that stronger pairs contradict (contradicted_joint.h) is replaced by these pairs. The
//   new models are used if they contradict fewer (ContradictedJoint::excess) and have 0.98 of the
//   score or more. Where they are more, or do not agree with the strongest of the pairs, they need
//   1.1 times the score.
// - A joint weaker than 1 (ModelShape::weakest_joint), the strength of a single pair, is opened.
//   The new models are used if the score rises.
// The score is the sum of trust times shape_trust() times n - 2 over models of n images. Shapes are
// judged by all `pairs`, also those that a model was made without.
// Each is repeated up to four times. `made.log` has a line for each attempt, and `made.refused` the
// pairs that are left out. Passes exceptions of `map` on; `made` is then as after the last step.
void correct_joints(const std::vector<Pair>& pairs, const MapPairs& map, Reconstruction& made);

}  // namespace tarsier::sfm
