// SPDX-License-Identifier: MIT
#include "verbs/aam/engine.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/appearance/start.h"
#include "tarsier/face/landmarks/face_finder.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "framework/bind.h"
#include "verbs/landmarks/engine.h"
#include <utility>

namespace tarsier::cli {
namespace {

using Eigen::Matrix2Xd;
using Starts = std::vector<std::vector<Matrix2Xd>>;

cv::Mat gray_of(const cv::Mat& image) {
  cv::Mat gray;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

face::appearance::FindStarts from_detector(const face::appearance::AppearanceModel& model,
                                           const AamFlags& flags) {
  face::landmarks::FaceFinderOptions options;
  options.detector.min_face = flags.min_face;
  options.detector.check();
  const auto finder = std::make_shared<face::landmarks::FaceFinder>(make_face_finder(options));
  return [finder, &model, count = flags.starts](const cv::Mat& image) {
    Starts starts;
    for (const face::landmarks::Candidate& candidate : finder->find(gray_of(image)))
      starts.push_back(face::appearance::starts_around(
          face::appearance::start_in_box(model, candidate.box), count));
    return starts;
  };
}

face::appearance::FindStarts from_landmarks(const face::appearance::AppearanceModel& model,
                                            const AamFlags& flags, const std::string& path) {
  LandmarkFlags landmark_flags;
  landmark_flags.min_face = flags.min_face;
  const auto tracker =
      std::make_shared<const face::LandmarkTracker>(load_landmark_tracker(landmark_flags));
  const int points = tracker->model().points();
  if (points != model.points()) {
    throw ModelError(path, fmt::format("has {} points, the landmark tracker {}; use --start "
                                       "detector or search",
                                       model.points(), points));
  }
  const auto state = std::make_shared<face::LandmarkState>();
  return [tracker, state, count = flags.starts](const cv::Mat& image) {
    Starts starts;
    Frame frame;
    frame.image = image;
    frame.still = true;
    for (const face::landmarks::TrackedFace& face : tracker->process(frame, *state).faces)
      starts.push_back(face::appearance::starts_around(face.points, count));
    return starts;
  };
}

face::appearance::FindStarts from_search(const face::appearance::Fitter& fitter) {
  const auto workspace = std::make_shared<face::appearance::FitWorkspace>();
  return [&fitter, workspace](const cv::Mat& image) {
    Starts starts;
    const auto start = face::appearance::search_start(fitter, image, {}, *workspace);
    if (start) starts.push_back({*start});
    return starts;
  };
}

}  // namespace

std::string shipped_appearance_model() { return ModelStore::find().path("aam68.json"); }

void add_aam_flags(Command& verb, AamFlags& flags) {
  verb.add_option("--model", flags.model, "model file [aam68.json, which ships]");
  verb.add_option("--method", flags.method,
                  "project-out (everything precomputed) or alternating (exact, dearer, better on "
                  "what the model has not seen) [alternating]")
      .check(one_of({"auto", "project-out", "alternating"}));
  verb.add_option("--start", flags.start,
                  "where fits begin: detector (faces), landmarks (the tracker of 68 points), "
                  "search (the whole image) [detector where the model was learnt with one]")
      .check(one_of({"auto", "detector", "landmarks", "search"}));
  verb.add_option("--starts", flags.starts, "fits around each start, of which the best stays")
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

AamEngine make_aam_engine(const AamFlags& flags) {
  AamEngine engine;
  engine.path = flags.model.empty() ? shipped_appearance_model() : flags.model;
  face::appearance::FitOptions fit = flags.fit;
  fit.method = flags.method == "project-out" ? face::appearance::Method::kProjectOut
                                             : face::appearance::Method::kAlternating;
  fit.check();
  const EndOnSignals at_once;  // reading takes a moment, and nothing is written yet
  throw_if_stopped(stop_on_signals());
  engine.model = std::make_unique<face::appearance::AppearanceModel>(
      face::appearance::read_appearance_model(engine.path));
  engine.fitter = std::make_unique<face::appearance::Fitter>(*engine.model, fit);
  const bool knows_boxes = engine.model->place.seen > 0;
  if (flags.start == "detector" && !knows_boxes) {
    throw ModelError(
        engine.path,
        "was trained on objects that the face detector does not find; use --start search");
  }
  if (flags.start == "landmarks") {
    engine.find = from_landmarks(*engine.model, flags, engine.path);
  } else if (flags.start == "search" || !knows_boxes) {
    engine.find = from_search(*engine.fitter);
  } else {
    engine.find = from_detector(*engine.model, flags);
  }
  return engine;
}

}  // namespace tarsier::cli
