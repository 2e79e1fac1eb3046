// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <cstddef>
#include <vector>

namespace tarsier::sfm {

// Evidence against the shape of a whole model, where each image agrees with its neighbours.
//
// tracks.h defines the strength of a pair, and pair_agreement.h its agreement with a model.
struct ModelShape {
  struct MissedPair {
    std::size_t pair = 0;  // index of the pair
    double strength = 0;
    bool closes_loop = false;  // open_loops.h
  };
  // Pairs that the model nearly fulfils. They have 30 inliers or more, and a strength of 0.7 or an
  // open loop. The model contradicts them, but by a rotation of at most 45 degrees. The distance of
  // the images is at most eight times what is usual for the agreeing pairs of either. Most are true
  // neighbours: errors have accumulated between them, or wrong pairs have displaced a part of the
  // model.
  std::vector<MissedPair> missed_pairs;
  // The smallest sum of strengths of agreeing pairs that connects two parts of three images or
  // more, over the cuts along a maximum spanning tree. 0 where nothing connects them, infinite
  // where there are no two such parts.
  double weakest_joint = 0;
  std::vector<int> weakest_part;  // images of one of its two parts
  // Images that show places which the model lacks (missing_places.h); not set by shape_of().
  int missing_places = 0;
};

[[nodiscard]] ModelShape shape_of(const Model& model, const std::vector<Pair>& pairs);

// Whether the model lacks a place, or misses two pairs or more that have a strength of 0.85 or
// close a loop. Weaker pairs may also show similar places side by side.
[[nodiscard]] bool is_unreliable(const ModelShape& shape);

// Factor of a model's trust and score where its shape is unreliable.
inline constexpr double kUnreliableTrustFactor = 0.5;

// 0 to 1: half the weakest joint, at most 1; half of that where the shape is unreliable.
[[nodiscard]] double shape_trust(const ModelShape& shape);

}  // namespace tarsier::sfm
