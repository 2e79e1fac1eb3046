// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/pipelines/landmark_tracker.h"

#include "framework/cli.h"
#include <string>

namespace tarsier::cli {

// The flags of all verbs that fit landmarks.
struct LandmarkFlags {
  std::string model;     // empty: the shipped model
  std::string detector;  // face detector: a file, or "cascades"; empty: the shipped one
  std::string method;    // empty: the model's best
  face::landmarks::FitOptions fit;
  double min_face = 0;  // px, smallest face to search for; 0: the default
  bool thorough = true;
  std::string rolled = "auto";  // see face::landmarks::RolledSearch
};

// Adds --min-face, px; `min_face` 0 is the default size.
Flag& add_min_face_flag(Command& verb, double& min_face);

// Adds --rolled: when to search for rolled faces.
Flag& add_rolled_flag(Command& verb, std::string& rolled);

void add_landmark_flags(Command& verb, LandmarkFlags& flags);

// Throws UsageError for an unknown method.
[[nodiscard]] face::LandmarkTrackerOptions landmark_options(
    const LandmarkFlags& flags, const face::landmarks::TrackerOptions& tracking = {});

// Uses the shipped models. Throws as face::LandmarkTracker::load() does, and Interrupted.
[[nodiscard]] face::LandmarkTracker load_landmark_tracker(
    const LandmarkFlags& flags, const face::landmarks::TrackerOptions& tracking = {});

// A face finder with the shipped detector. Throws ModelError.
[[nodiscard]] face::landmarks::FaceFinder make_face_finder(
    const face::landmarks::FaceFinderOptions& options = {});

}  // namespace tarsier::cli
