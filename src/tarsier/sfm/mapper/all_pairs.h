// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/mapper.h"
#include "tarsier/sfm/scene/model.h"

#include <stop_token>
#include <vector>

// Models that were made of some of the pairs, judged by all of them. A model of the strongest pairs may be folded and show
// no conflict: the places that lie over each other have no points in common where the pairs between them were left out. But
// the model agrees with these pairs, and with their points the details of one place are missing in the images of the other.
namespace tarsier::sfm {

// The model with its poses and cameras, and with points of the pairs that are named, made again.
[[nodiscard]] Model with_points_of(const Model& model, const std::vector<const Pair*>& pairs,
                                   const MapperInput& input, const MapperOptions& options);

// Sets the trust of each model and of its images. It is trust_of() by the pairs that the model agrees with
// (pair_agreement.h); those that it does not agree with say nothing, as of repeated places most of them are wrong. Off it
// goes the share of near images that contradict an image (model_conflicts.h), times 5, once the model has the points of
// all pairs that it agrees with. Throws Interrupted: models that were not judged yet have the trust that they had.
void judge_by_all_pairs(const MapperInput& input, const MapperOptions& options,
                        const std::stop_token& stop, Reconstruction& reconstruction);

}  // namespace tarsier::sfm
