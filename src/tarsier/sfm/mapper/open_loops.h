// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/tracks.h"
#include "tarsier/sfm/scene/model.h"

#include <vector>

namespace tarsier::sfm {

// Loops that a model leaves open: verified pairs of 30 inliers or more whose images lie elsewhere in the model than the
// pair says (pair_agreement.h), and which pairs that agree do not join, or only by a way of 8 or more. Errors of many
// steps have added up along it, or the pair is a wrong one. None where less than half of all inliers agree: then the
// model is wrong as a whole, or the focal length is.
[[nodiscard]] std::vector<const Pair*> open_loops(const Model& model,
                                                  const std::vector<const Pair*>& pairs);

// Inliers of the pairs that agree with a model.
[[nodiscard]] double agreeing_inliers(const Model& model, const std::vector<const Pair*>& pairs);

}  // namespace tarsier::sfm
