// SPDX-License-Identifier: MIT
#pragma once

#include "verbs/landmarks/landmarks.h"
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

// What the trainings of detectors from boxes have in common.
namespace tarsier::cli {

// What every model says of its training; a verb adds what it counted.
[[nodiscard]] nlohmann::json box_training_provenance(const TrainingFlags& flags,
                                                     const Context& context);

void warn_of_skipped(const std::vector<std::string>& skipped);

}  // namespace tarsier::cli
