// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/appearance/fit.h"
#include "tarsier/face/pipelines/appearance_tracker.h"

#include "framework/cli.h"
#include <string>

namespace tarsier::cli {

// The flags of all verbs that fit an appearance model.
struct AamFlags {
  std::string model;            // empty: the shipped model
  std::string method = "auto";  // project-out, alternating; auto: alternating
  std::string start = "auto";   // detector, landmarks, search; auto: as the model allows
  int starts = 1;               // fits per start position
  double min_face = 0;          // px; 0: the default
  face::appearance::FitOptions fit;
  face::appearance::TrackOptions track;
};
void add_aam_flags(Command& verb, AamFlags& flags);

// Uses the shipped models. Throws as face::AppearanceTracker::load() does, and Interrupted.
[[nodiscard]] face::AppearanceTracker load_appearance_tracker(const AamFlags& flags);

[[nodiscard]] std::string shipped_appearance_model();

}  // namespace tarsier::cli
