// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/appearance/fit.h"
#include "tarsier/face/pipelines/appearance_tracker.h"

#include "framework/cli.h"
#include <string>

namespace tarsier::cli {

// The flags of every verb that fits an appearance model.
struct AamFlags {
  std::string model;            // empty: the one that ships
  std::string method = "auto";  // project-out, alternating; auto: alternating
  std::string start = "auto";   // detector, landmarks, search; auto: as the model can
  int starts = 1;               // around each
  double min_face = 0;          // px; 0: the usual
  face::appearance::FitOptions fit;
  face::appearance::TrackOptions track;
};
void add_aam_flags(Command& verb, AamFlags& flags);

// With the models that ship. Throws as face::AppearanceTracker::load(), Interrupted.
[[nodiscard]] face::AppearanceTracker load_appearance_tracker(const AamFlags& flags);

[[nodiscard]] std::string shipped_appearance_model();

}  // namespace tarsier::cli
