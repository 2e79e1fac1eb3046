// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/pipelines/pipeline.h"

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace tarsier::sfm {

// The content of report.json:
// - "models" (images, points, observations, mean_track, reprojection_px, cameras),
// - "images" (name, file, registered, model, features, points, reason), "pairs", "stages", "log",
// - "start_model" where mapping began with one: its number of "images", how many of these are
//   "here" among the inputs and "registered" with poses that agree with the matches, "fixed_poses",
//   "folder",
// - "parts" and "joins" where models were joined,
// - "partial": true where the work was interrupted, "resumed": images of a checkpoint.
[[nodiscard]] nlohmann::ordered_json report_json(const PipelineResult& result);

// A readable summary: a few lines, and each missing image with the reason.
[[nodiscard]] std::string summary_text(const PipelineResult& result);

}  // namespace tarsier::sfm
