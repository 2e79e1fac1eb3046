// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/landmarks/model.h"

#include "cli.h"
#include <string>

namespace tarsier::cli {

// The flags of every verb that finds points.
struct LandmarkFlags {
  std::string model;     // empty: the one that ships
  std::string detector;  // trained face detector; empty: the cascades
  std::string method;    // empty: the model's best
  landmarks::FitOptions fit;
  double min_face = 0.1;  // smallest face, share of the picture's smaller side
  bool thorough = true;
};

void add_landmark_flags(CLI::App& verb, LandmarkFlags& flags);

struct LandmarkEngine {
  landmarks::LandmarkModel model;
  landmarks::FitOptions fit;
  landmarks::FaceFinder finder;
};

// Reads the model and checks that it can do what was asked. Throws ModelError, UsageError.
[[nodiscard]] LandmarkEngine make_landmark_engine(const LandmarkFlags& flags);

}  // namespace tarsier::cli
