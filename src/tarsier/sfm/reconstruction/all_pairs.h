// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/mapper_input.h"
#include "tarsier/sfm/mapper/mapper_options.h"
#include "tarsier/sfm/mapper/reconstruction.h"
#include "tarsier/sfm/scene/model.h"

#include <stop_token>
#include <vector>

// Evaluates models made from some of the pairs by all pairs. A model of the strongest pairs may be
// folded without any conflict: superimposed places share no points where the pairs between them
// were left out. But the model agrees with those pairs, and once their points are added, details of
// one place are missing in the images of the other.
namespace tarsier::sfm {

// The model with the same poses and cameras, and with points triangulated again from `pairs`.
[[nodiscard]] Model retriangulated(const Model& model, const std::vector<const Pair*>& pairs,
                                   const MapperInput& input, const MapperOptions& options);

// Sets the trust of each model and its images. It is trust_of() by the pairs that agree with the
// model (pair_agreement.h), times 1 - 5 s, at least 0. Here s is the share of nearby images that
// contradict an image (model_conflicts.h), once the model has the points of all pairs that agree
// with it. Pairs that do not agree are ignored, since most of them are wrong where places repeat.
// Throws Interrupted: models that were not evaluated yet keep their trust.
void update_trust_by_all_pairs(const MapperInput& input, const MapperOptions& options,
                               const std::stop_token& stop, Reconstruction& reconstruction);

}  // namespace tarsier::sfm
