// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/mapper/doubt.h"
#include "tarsier/sfm/mapper/mapper.h"
#include "tarsier/sfm/mapper/model_conflicts.h"
#include "tarsier/sfm/mapper/repeated_structure.h"

#include <memory>
#include <string>
#include <string_view>
#include <vector>

// The inside of the mapper: what is said of models, images and pairs once the models are made.
namespace tarsier::sfm {

// Begins the line of the log that says why images were not mapped globally.
inline constexpr std::string_view kGlobalRefusal = "global mapping refused: ";

// Orders the models of `made`, largest first, without those that are too small, and tells which pairs were refused, what
// became of each image, and how much each model is to be trusted. `evidence` and `doubts` are of each pair of the input,
// `conflicts` of each model, where they are known. `repeats`: as ModelConflicts::any() takes it.
void add_outcomes(const MapperInput& input, const MapperOptions& options,
                  const std::vector<PairEvidence>& evidence, const std::vector<Doubt>& doubts,
                  bool repeats, std::vector<std::shared_ptr<const ModelConflicts>> conflicts,
                  Reconstruction& made);

}  // namespace tarsier::sfm
