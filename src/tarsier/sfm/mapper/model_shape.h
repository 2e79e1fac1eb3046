// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/tracks.h"
#include "tarsier/sfm/scene/model.h"

#include <cstddef>
#include <vector>

namespace tarsier::sfm {

// What speaks against the shape of a whole model, where each image agrees with its neighbours.
//
// The strength of a pair is its inliers by those of the strongest pair of either of its images: an image has most in common
// with its true neighbours. A pair agrees with a model as pair_agreement.h says.
struct ModelShape {
  struct Missed {
    std::size_t pair = 0;  // its number
    double strength = 0;
    bool closes_loop = false;  // open_loops.h
  };
  // Pairs that the model just misses: of 30 inliers or more, and of a strength of 0.7 or the end of an open loop, which it
  // contradicts, but turns by 45 degrees or less from what the pair says, with the images no more than eight times as far
  // apart as either usually is from those that it agrees with. Most are neighbours in truth; errors have added up between
  // them, or wrong pairs have put a part of the model beside its place.
  std::vector<Missed> missed;
  // Of the pairs that agree the least sum of strengths that joins two parts of three images or more, over the cuts along a
  // maximum spanning tree; 0 where nothing joins them, and infinite where there are no two such parts.
  double weakest_joint = 0;
};

[[nodiscard]] ModelShape shape_of(const Model& model, const std::vector<Pair>& pairs);

// Whether two pairs or more are missed that are of a strength of 0.85 or close a loop. Weaker ones may also show places side
// by side that look alike.
[[nodiscard]] bool is_doubtful(const ModelShape& shape);

// What a doubtful shape leaves of a model's trust and score.
inline constexpr double kDoubtfulTrust = 0.5;

// 0 to 1: half the weakest joint, 1 at most; half of that where the shape is doubtful.
[[nodiscard]] double shape_trust(const ModelShape& shape);

}  // namespace tarsier::sfm
