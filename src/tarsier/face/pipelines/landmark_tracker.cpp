// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/landmark_tracker.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/face/landmarks/faces_json.h"
#include "tarsier/media/still_source.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

namespace tarsier::face {

void LandmarkTrackerOptions::check() const {
  finder.detector.check();
  fit.check();
  tracker.check();
}

nlohmann::ordered_json to_json(const LandmarkResult& result) {
  return {{"faces", landmarks::faces_json(result.faces, result.tracked)},
          {"ms", std::round(result.ms * 100) / 100}};
}

LandmarkTracker::LandmarkTracker(std::shared_ptr<const landmarks::LandmarkModel> model,
                                 DetectorModel detector, const LandmarkTrackerOptions& options)
    : model_(std::move(model)),
      detector_(std::move(detector)),
      fit_(options.fit),
      tracking_(options.tracker) {
  TARSIER_REQUIRE(model_ != nullptr, "a landmark model is needed");
  options.check();
}

LandmarkTracker LandmarkTracker::load(const ModelStore& models,
                                      const LandmarkTrackerOptions& options) {
  options.check();
  const std::string path = models.path_or(options.model, "landmarks68.json");
  auto model =
      std::make_shared<const landmarks::LandmarkModel>(landmarks::read_landmark_model(path));
  if (options.fit.method && !model->has(*options.fit.method)) {
    throw ModelError(path,
                     fmt::format("has no part for the method {}; train it with `landmarks train "
                                 "tracker`",
                                 landmarks::name_of(*options.fit.method)));
  }
  return {std::move(model), DetectorModel::load(models, options.detector, options.finder), options};
}

void LandmarkTracker::set_tracking(const landmarks::TrackerOptions& options) {
  options.check();
  tracking_ = options;
}

LandmarkResult LandmarkTracker::process(const Frame& frame, LandmarkState& state,
                                        DebugSink* debug) const {
  if (!state.finder) state.finder.emplace(detector_.make_finder());
  const std::string source = source_of(frame);
  if (frame.still || source != state.source) state.tracker = {};
  state.source = source;
  const auto start = std::chrono::steady_clock::now();
  const cv::Mat& gray = gray_of(frame.image, state.gray);
  LandmarkResult result;
  result.tracked = !frame.still;
  if (frame.still) {
    for (landmarks::FittedFace& found : landmarks::find_faces(
             *model_, fit_, gray, *state.finder, state.workspace, tracking_.min_new, debug)) {
      result.faces.push_back({static_cast<int>(result.faces.size()) + 1,
                              std::move(found.fit.points), found.fit.score, found.box,
                              found.detection, std::move(found.fit.visibility)});
    }
  } else {
    result.faces = landmarks::track_faces(*model_, fit_, tracking_, *state.finder, state.tracker,
                                          gray, frame.time, state.workspace, debug);
  }
  const std::chrono::duration<double, std::milli> spent = std::chrono::steady_clock::now() - start;
  result.ms = spent.count();
  return result;
}

void redetect(LandmarkState& state) { landmarks::redetect(state.tracker); }

const cv::Mat& gray_of(const cv::Mat& image, cv::Mat& gray) {
  TARSIER_REQUIRE(!image.empty() && (image.type() == CV_8UC3 || image.type() == CV_8UC1),
                  "an image of type {}", image.type());
  if (image.type() == CV_8UC1) return image;
  cv::cvtColor(image, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

}  // namespace tarsier::face
