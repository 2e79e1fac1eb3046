// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <cstdint>
#include <vector>

namespace tarsier::sfm {

// Trust in the pose of each image of a model, 0 to 1; 0 for unregistered images. It is a score to
// order images by, not a probability. It is the product of three factors, each at most 1:
// - The share of the inliers of its pairs with registered images that agree with the model
//   (pair_agreement.h). Pairs refused for missing evidence count against the image where the model
//   agrees with them; otherwise they are ignored.
// - Its number of points / 50, times the number of cells of 8 x 6 that contain them / 12.
// - The share of its points that three images or more show / 0.5.
//
// The mapper lowers it for remaining conflicts (model_conflicts.h). Where there are conflicts, it
// evaluates by all pairs (reconstruction/all_pairs.h).
//
// `refused`: for each pair, 1 or 0.
[[nodiscard]] std::vector<double> trust_of(const Model& model, const std::vector<Pair>& pairs,
                                           const std::vector<std::uint8_t>& refused);

// The mean over the registered images.
[[nodiscard]] double model_trust(const Model& model, const std::vector<double>& trust);

}  // namespace tarsier::sfm
