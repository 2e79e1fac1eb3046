// SPDX-License-Identifier: MIT
#include "landmark_engine.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/landmarks/hog_detector.h"

#include <fmt/format.h>

#include <filesystem>

namespace tarsier::cli {

void add_landmark_flags(CLI::App& verb, LandmarkFlags& flags) {
  verb.add_option("--model", flags.model, "model file [landmarks68.json, which ships]");
  verb.add_option(
      "--method", flags.method,
      "both (mean of trees and sdm), trees, sdm or patch [the best that the model has]");
  verb.add_option("--starts", flags.fit.starts, "fits of the trees that are averaged")
      ->capture_default_str();
  verb.add_option("--min-face", flags.min_face,
                  "smallest face that is looked for, share of the picture's smaller side")
      ->capture_default_str();
  verb.add_option("--face-detector", flags.detector,
                  "detector of `landmarks train face-detector` that finds the faces [the cascades "
                  "of opencv-data]");
  verb.add_flag("!--strict", flags.thorough,
                "only faces that the frontal detector is sure of: faster where there are none");
}

landmarks::FaceFinder make_face_finder(const LandmarkFlags& flags,
                                       const landmarks::FaceFinderOptions& options) {
  if (flags.detector.empty()) return landmarks::FaceFinder(options);
  return {landmarks::read_hog_detector(flags.detector), options};
}

LandmarkEngine make_landmark_engine(const LandmarkFlags& flags) {
  const std::string path =
      flags.model.empty()
          ? (std::filesystem::path(find_models_folder("")) / "landmarks68.json").string()
          : flags.model;
  landmarks::FaceFinderOptions finder;
  finder.detector.min_size = flags.min_face;
  finder.thorough = flags.thorough;
  finder.detector.check();
  const EndOnSignals at_once;  // reading takes a moment, and nothing is written yet
  LandmarkEngine engine{landmarks::read_landmark_model(path), flags.fit,
                        make_face_finder(flags, finder)};
  if (!flags.method.empty()) engine.fit.method = landmarks::parse_fit_method(flags.method);
  engine.fit.check();
  if (engine.fit.method && !engine.model.has(*engine.fit.method)) {
    throw ModelError(path,
                     fmt::format("has no part for --method {}; train it with `landmarks train "
                                 "tracker`",
                                 landmarks::name_of(*engine.fit.method)));
  }
  return engine;
}

}  // namespace tarsier::cli
