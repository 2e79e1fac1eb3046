// SPDX-License-Identifier: MIT
#include "verbs/aam/engine.h"

#include "tarsier/core/stop.h"

#include "framework/bind.h"
#include "verbs/landmarks/engine.h"

namespace tarsier::cli {
namespace {

face::AppearanceStart parse_start(const std::string& name) {
  if (name == "detector") return face::AppearanceStart::kDetector;
  if (name == "landmarks") return face::AppearanceStart::kLandmarks;
  return name == "search" ? face::AppearanceStart::kSearch : face::AppearanceStart::kAuto;
}

}  // namespace

std::string shipped_appearance_model() { return ModelStore::find().path("aam68.json"); }

void add_aam_flags(Command& verb, AamFlags& flags) {
  verb.add_option("--model", flags.model, "model file [aam68.json, shipped]");
  verb.add_option("--method", flags.method,
                  "project-out (precomputed, fast) or alternating (exact, slower, better on unseen "
                  "faces) [alternating]")
      .check(one_of({"auto", "project-out", "alternating"}));
  verb.add_option("--start", flags.start,
                  "initialisation: detector, landmarks (68 points) or search (whole image) "
                  "[detector if the model has one]")
      .check(one_of({"auto", "detector", "landmarks", "search"}));
  verb.add_option("--starts", flags.starts,
                  "number of fits around each initial position; the best is kept")
      .check(range(1, 100))
      .show_default();
  add_min_face_flag(verb, flags.min_face);
  Flag& iterations = bind_field(verb, flags.fit, flags.fit.iterations);
  Flag& prior = bind_field(verb, flags.fit, flags.fit.shape_prior);
  Flag& sigmas = bind_field(verb, flags.fit, flags.fit.sigmas);
  Flag& refresh = bind_field(verb, flags.fit, flags.fit.refresh);
  Flag& robust = bind_field(verb, flags.fit, flags.fit.robust);
  for (Flag* flag : {&iterations, &prior, &sigmas, &refresh, &robust}) flag->group("The fit");
}

face::AppearanceTracker load_appearance_tracker(const AamFlags& flags) {
  face::AppearanceTrackerOptions options;
  options.model = flags.model;
  options.start = parse_start(flags.start);
  options.starts = flags.starts;
  options.landmarks.finder.detector.min_face = flags.min_face;
  options.fit = flags.fit;
  options.fit.method = flags.method == "project-out" ? face::appearance::Method::kProjectOut
                                                     : face::appearance::Method::kAlternating;
  options.tracker = flags.track;
  options.check();
  const EndOnSignals at_once;  // loading takes a moment, and nothing is written yet
  throw_if_stopped(stop_on_signals());
  return face::AppearanceTracker::load(ModelStore::find(), options);
}

}  // namespace tarsier::cli
