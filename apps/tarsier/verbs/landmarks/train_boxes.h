// SPDX-License-Identifier: MIT
#pragma once

#include "verbs/landmarks/landmarks.h"
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

// Common parts of the trainings of detectors from boxes.
namespace tarsier::cli {

// The provenance of a trained model; each verb adds its own counts.
[[nodiscard]] nlohmann::json box_training_provenance(const TrainingFlags& flags,
                                                     const Context& context);

void warn_of_skipped(const std::vector<std::string>& skipped);

}  // namespace tarsier::cli
