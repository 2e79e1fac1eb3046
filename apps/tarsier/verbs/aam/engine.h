// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/appearance/fit.h"
#include "tarsier/face/appearance/tracker.h"

#include "framework/cli.h"
#include <memory>
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
};
void add_aam_flags(Command& verb, AamFlags& flags);

// A model, ready to be fitted. `fitter` refers to `model`.
struct AamEngine {
  std::string path;
  std::unique_ptr<face::appearance::AppearanceModel> model;
  std::unique_ptr<face::appearance::Fitter> fitter;
  face::appearance::FindStarts find;
};
// Throws ModelError, UsageError.
[[nodiscard]] AamEngine make_aam_engine(const AamFlags& flags);

[[nodiscard]] std::string shipped_appearance_model();

}  // namespace tarsier::cli
