// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/consistency/model_conflicts.h"
#include "tarsier/sfm/consistency/pair_rejection.h"
#include "tarsier/sfm/consistency/repeated_structure.h"
#include "tarsier/sfm/mapper/mapper_input.h"
#include "tarsier/sfm/mapper/mapper_options.h"
#include "tarsier/sfm/mapper/reconstruction.h"

#include <memory>
#include <string>
#include <string_view>
#include <vector>

// Internal to the mappers: the results for models, images and pairs, once the models are made.
namespace tarsier::sfm {

// Start of the log line with the reason why global mapping failed.
inline constexpr std::string_view kGlobalFailure = "global mapping failed: ";

// Sorts the models of `made`, largest first, drops too small ones, and sets the refused pairs, the
// outcome of each image and the trust of each model. Where no model is left, sets the reason,
// unless `made` has one. `evidence` and `rejections`: for each pair of the input. `conflicts`: for
// each model, where known. `is_repetitive`: see ModelConflicts::any().
void add_outcomes(const MapperInput& input, const MapperOptions& options,
                  const std::vector<PairEvidence>& evidence,
                  const std::vector<PairRejection>& rejections, bool is_repetitive,
                  std::vector<std::shared_ptr<const ModelConflicts>> conflicts,
                  Reconstruction& made);

}  // namespace tarsier::sfm
