// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/pipelines/landmark_tracker.h"

#include "framework/cli.h"
#include <string>

namespace tarsier::cli {

// The flags of every verb that finds points.
struct LandmarkFlags {
  std::string model;     // empty: the one that ships
  std::string detector;  // face detector: a file, or "cascades"; empty: the one that ships
  std::string method;    // empty: the model's best
  face::landmarks::FitOptions fit;
  double min_face = 0;  // px, smallest face that is looked for; 0: the usual
  bool thorough = true;
  std::string rolled = "auto";  // see face::landmarks::RolledSearch
};

// --min-face: px; 0 in `min_face` is the usual size.
Flag& add_min_face_flag(Command& verb, double& min_face);

// --rolled: when faces that are rolled are looked for.
Flag& add_rolled_flag(Command& verb, std::string& rolled);

void add_landmark_flags(Command& verb, LandmarkFlags& flags);

// Throws UsageError for an unknown method.
[[nodiscard]] face::LandmarkTrackerOptions landmark_options(
    const LandmarkFlags& flags, const face::landmarks::TrackerOptions& tracking = {});

// With the models that ship. Throws as face::LandmarkTracker::load(), Interrupted.
[[nodiscard]] face::LandmarkTracker load_landmark_tracker(
    const LandmarkFlags& flags, const face::landmarks::TrackerOptions& tracking = {});

// What ships finds the faces. Throws ModelError.
[[nodiscard]] face::landmarks::FaceFinder make_face_finder(
    const face::landmarks::FaceFinderOptions& options = {});

}  // namespace tarsier::cli
