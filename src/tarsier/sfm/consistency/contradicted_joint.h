// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <cstddef>
#include <optional>
#include <vector>

namespace tarsier::sfm {

// A joint of a model that stronger pairs contradict.
//
// The bottleneck of two images is the largest strength (strength_of()) such that agreeing pairs of
// at least this strength connect them (pair_agreement.h): the weakest edge on their path in the
// maximum spanning tree. An image has most in common with its true neighbours. If a contradicted
// pair is stronger than the bottleneck of its two images, then weaker evidence has placed one of
// the two parts that this bottleneck joins.
struct ContradictedJoint {
  std::size_t pair = 0;   // index of the contradicted pair that exceeds its bottleneck most
  double strength = 0;    // of that pair
  double bottleneck = 0;  // of its images
  // Images of the smaller part: those that stronger pairs than the bottleneck connect to one of the
  // images.
  std::vector<int> part;
  // Indices of the contradicted pairs that place the part as `pair` does (their rotations between
  // part and rest differ by at most 10 degrees), with at least 0.7 of its strength.
  std::vector<std::size_t> replacing;
  // The sum of strength - bottleneck over all contradicted pairs that exceed their bottleneck 1.1
  // times.
  double excess = 0;
};

// The joint whose contradicted pair exceeds its bottleneck by the largest factor. No value where
// none of 30 inliers or more exceeds it 1.1 times.
[[nodiscard]] std::optional<ContradictedJoint> contradicted_joint(const Model& model,
                                                                  const std::vector<Pair>& pairs);

}  // namespace tarsier::sfm
