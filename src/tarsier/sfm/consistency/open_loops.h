// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"
#include "tarsier/sfm/two_view/tracks.h"

#include <vector>

namespace tarsier::sfm {

// Finds loops that a model leaves open. These are verified pairs of 30 inliers or more whose
// relative pose contradicts the model (pair_agreement.h). Agreeing pairs do not connect their
// images, or only over 8 or more steps. Either errors have accumulated along that path, or the pair
// is wrong. Empty where less than half of all inliers agree: then the model as a whole or the focal
// length is wrong.
[[nodiscard]] std::vector<const Pair*> open_loops(const Model& model,
                                                  const std::vector<const Pair*>& pairs);

// Number of inliers of the pairs that agree with a model.
[[nodiscard]] double agreeing_inliers(const Model& model, const std::vector<const Pair*>& pairs);

}  // namespace tarsier::sfm
