// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/tracks.h"
#include "tarsier/sfm/scene/model.h"

#include <cstdint>
#include <vector>

namespace tarsier::sfm {

// How much speaks for the pose of each image of a model, 0 to 1; 0 for those that are not registered. A score to order
// images by, not a probability: the product of
//
//   the share of the inliers of its pairs with registered images that agree with the model (pair_agreement.h); pairs that were
//   refused for what they should have in common and have not count against it where the model agrees with them;
//   its points, of 50, times the cells of 8 x 6 that they lie in, of 12;
//   the share of its points that three images or more show, of a half.
//
// The mapper takes off it what conflicts are left (model_conflicts.h), and where there are any, judges by all pairs
// (all_pairs.h).
//
// `refused`: of each pair, 1 or 0.
[[nodiscard]] std::vector<double> trust_of(const Model& model, const std::vector<Pair>& pairs,
                                           const std::vector<std::uint8_t>& refused);

// The mean over the registered images.
[[nodiscard]] double model_trust(const Model& model, const std::vector<double>& trust);

}  // namespace tarsier::sfm
