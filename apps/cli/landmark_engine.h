// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/landmarks/model.h"

#include "cli.h"
#include <memory>
#include <string>

namespace tarsier::cli {

// The flags of every verb that finds points.
struct LandmarkFlags {
  std::string model;     // empty: the one that ships
  std::string detector;  // face detector: a file, or "cascades"; empty: the one that ships
  std::string method;    // empty: the model's best
  landmarks::FitOptions fit;
  double min_face = 0;  // px, smallest face that is looked for; 0: the usual
  bool thorough = true;
};

// --min-face: px; 0 in `min_face` is the usual size.
Flag& add_min_face_flag(Command& verb, double& min_face);

// The networks that ship (models/face-detector.json); nothing, with a warning, where they are not
// there: then the cascades of OpenCV look.
[[nodiscard]] std::shared_ptr<const FaceNetworks> shipped_face_networks();

// By a file of either kind of face detector, or by "cascades"; empty: what ships. Throws
// ModelError.
[[nodiscard]] landmarks::FaceFinder make_face_finder(const std::string& detector,
                                                     const landmarks::FaceFinderOptions& options);

void add_landmark_flags(Command& verb, LandmarkFlags& flags);

struct LandmarkEngine {
  landmarks::LandmarkModel model;
  landmarks::FitOptions fit;
  landmarks::FaceFinder finder;
};

// Reads the model and checks that it can do what was asked. Throws ModelError, UsageError.
[[nodiscard]] LandmarkEngine make_landmark_engine(const LandmarkFlags& flags);

}  // namespace tarsier::cli
