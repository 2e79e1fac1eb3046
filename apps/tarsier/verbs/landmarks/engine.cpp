// SPDX-License-Identifier: MIT
#include "verbs/landmarks/engine.h"

#include "tarsier/core/stop.h"

#include "framework/bind.h"

namespace tarsier::cli {

void add_landmark_flags(Command& verb, LandmarkFlags& flags) {
  verb.add_option("--model", flags.model, "model file [landmarks68.json, shipped]");
  verb.add_option(
      "--method", flags.method,
      "mean (of trees, sdm and cnn if present), trees, sdm, cnn or patch [best of the model]");
  bind_field(verb, flags.fit, flags.fit.starts);
  add_min_face_flag(verb, flags.min_face);
  verb.add_option("--face-detector", flags.detector,
                  "file of `landmarks train`, own (face-detector.json) or cascades (opencv-data) "
                  "[own, plus the one of scripts/get-model.sh face-detector if installed]");
  verb.add_flag(
      "!--strict", flags.thorough,
      "accept only confident detections of the frontal detector; faster on images without faces");
  add_rolled_flag(verb, flags.rolled);
}

Flag& add_min_face_flag(Command& verb, double& min_face) {
  return verb
      .add_option("--min-face", min_face,
                  "px, minimum face width [40; 24 in images of up to half a megapixel]")
      .check(range(16, 4096));
}

Flag& add_rolled_flag(Command& verb, std::string& rolled) {
  return verb
      .add_option("--rolled", rolled,
                  "search for faces rolled by 20 to 60 degrees: auto (if no upright face is "
                  "found), always, never")
      .check(one_of({"auto", "always", "never"}))
      .show_default();
}

face::LandmarkTrackerOptions landmark_options(const LandmarkFlags& flags,
                                              const face::landmarks::TrackerOptions& tracking) {
  face::LandmarkTrackerOptions options;
  options.model = flags.model;
  options.detector = flags.detector;
  options.finder.detector.min_face = flags.min_face;
  options.finder.thorough = flags.thorough;
  options.finder.rolled = face::landmarks::parse_rolled_search(flags.rolled);
  options.fit = flags.fit;
  if (!flags.method.empty()) options.fit.method = face::landmarks::parse_fit_method(flags.method);
  options.tracker = tracking;
  return options;
}

face::LandmarkTracker load_landmark_tracker(const LandmarkFlags& flags,
                                            const face::landmarks::TrackerOptions& tracking) {
  const face::LandmarkTrackerOptions options = landmark_options(flags, tracking);
  options.check();
  const EndOnSignals at_once;  // loading takes a moment, and nothing is written yet
  throw_if_stopped(stop_on_signals());
  return face::LandmarkTracker::load(ModelStore::find(), options);
}

face::landmarks::FaceFinder make_face_finder(const face::landmarks::FaceFinderOptions& options) {
  return face::DetectorModel::load(ModelStore::find(), "", options).make_finder();
}

}  // namespace tarsier::cli
