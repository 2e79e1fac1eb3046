// SPDX-License-Identifier: MIT
#include "verbs/landmarks/engine.h"

#include "tarsier/core/stop.h"

#include "framework/bind.h"

namespace tarsier::cli {

void add_landmark_flags(Command& verb, LandmarkFlags& flags) {
  verb.add_option("--model", flags.model, "model file [landmarks68.json, which ships]");
  verb.add_option("--method", flags.method,
                  "mean (of trees, sdm and, if there is one, cnn), trees, sdm, cnn or patch [the "
                  "best that the model has]");
  bind_field(verb, flags.fit, flags.fit.starts);
  add_min_face_flag(verb, flags.min_face);
  verb.add_option("--face-detector", flags.detector,
                  "detector of `landmarks train` that finds the faces, `own`: face-detector.json, "
                  "which ships, or `cascades`: those of opencv-data [own, and beside it the one "
                  "that scripts/get-model.sh face-detector installs]");
  verb.add_flag("!--strict", flags.thorough,
                "only faces that the frontal detector is sure of: faster where there are none");
  add_rolled_flag(verb, flags.rolled);
}

Flag& add_min_face_flag(Command& verb, double& min_face) {
  return verb
      .add_option("--min-face", min_face,
                  "px, width of the smallest face that is looked for [40; 24 in images of up to "
                  "half a megapixel]")
      .check(range(16, 4096));
}

Flag& add_rolled_flag(Command& verb, std::string& rolled) {
  return verb
      .add_option("--rolled", rolled,
                  "when faces rolled by 20 to 60 degrees are looked for: auto (where no face is "
                  "found upright), always, never")
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
