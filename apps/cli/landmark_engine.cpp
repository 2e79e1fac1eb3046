// SPDX-License-Identifier: MIT
#include "landmark_engine.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/io/archive.h"
#include "tarsier/landmarks/hog_detector.h"

#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <utility>

namespace tarsier::cli {

void add_landmark_flags(Command& verb, LandmarkFlags& flags) {
  verb.add_option("--model", flags.model, "model file [landmarks68.json, which ships]");
  verb.add_option(
      "--method", flags.method,
      "both (mean of trees and sdm), trees, sdm or patch [the best that the model has]");
  verb.add_option("--starts", flags.fit.starts, "fits of the trees that are averaged")
      .show_default();
  add_min_face_flag(verb, flags.min_face);
  verb.add_option("--face-detector", flags.detector,
                  "detector of `landmarks train` that finds the faces, or `cascades`: those of "
                  "opencv-data [face-detector.json, which ships]");
  verb.add_flag("!--strict", flags.thorough,
                "only faces that the frontal detector is sure of: faster where there are none");
}

Flag& add_min_face_flag(Command& verb, double& min_face) {
  return verb
      .add_option("--min-face", min_face,
                  "px, width of the smallest face that is looked for [40; 24 in pictures of up to "
                  "half a megapixel]")
      .check(range(16, 4096));
}

std::shared_ptr<const FaceNetworks> shipped_face_networks() {
  const std::string path =
      (std::filesystem::path(find_models_folder("")) / "face-detector.json").string();
  std::error_code ignored;
  if (std::filesystem::exists(path, ignored)) {
    return std::make_shared<const FaceNetworks>(read_face_networks(path));
  }
  log_warning("{}: not there; faces are found by the cascades of opencv-data instead", path);
  return nullptr;
}

landmarks::FaceFinder make_face_finder(const std::string& detector,
                                       const landmarks::FaceFinderOptions& options) {
  if (detector == "cascades") return landmarks::FaceFinder(options);
  if (detector.empty()) {
    std::shared_ptr<const FaceNetworks> networks = shipped_face_networks();
    if (networks == nullptr) return landmarks::FaceFinder(options);
    return {std::move(networks), options};
  }
  if (read_any_archive(detector).type == kFaceNetworksType) {
    return {std::make_shared<const FaceNetworks>(read_face_networks(detector)), options};
  }
  return {landmarks::read_hog_detector(detector), options};
}

LandmarkEngine make_landmark_engine(const LandmarkFlags& flags) {
  const std::string path =
      flags.model.empty()
          ? (std::filesystem::path(find_models_folder("")) / "landmarks68.json").string()
          : flags.model;
  landmarks::FaceFinderOptions finder;
  finder.detector.min_face = flags.min_face;
  finder.thorough = flags.thorough;
  finder.detector.check();
  const EndOnSignals at_once;  // reading takes a moment, and nothing is written yet
  throw_if_stopped(stop_on_signals());
  LandmarkEngine engine{landmarks::read_landmark_model(path), flags.fit,
                        make_face_finder(flags.detector, finder)};
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
