// SPDX-License-Identifier: MIT
#include "tarsier/face/pipelines/appearance_tracker.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/face/appearance/start.h"
#include "tarsier/media/still_source.h"

#include <fmt/format.h>

#include <utility>

namespace tarsier::face {
namespace {

using Starts = std::vector<std::vector<Eigen::Matrix2Xd>>;

}  // namespace

void AppearanceTrackerOptions::check() const {
  TARSIER_REQUIRE(starts >= 1 && starts <= 100, "{} starts", starts);
  landmarks.check();
  fit.check();
  tracker.check();
}

AppearanceTracker AppearanceTracker::load(const ModelStore& models,
                                          const AppearanceTrackerOptions& options,
                                          std::shared_ptr<const LandmarkTracker> landmarks) {
  options.check();
  AppearanceTracker result;
  result.options_ = options;
  result.path_ = models.path_or(options.model, "aam68.json");
  result.model_ = std::make_shared<const appearance::AppearanceModel>(
      appearance::read_appearance_model(result.path_));
  result.fitter_ = std::make_shared<const appearance::Fitter>(*result.model_, options.fit);
  const bool knows_boxes = result.model_->shape_in_box.boxes > 0;
  if (options.start == AppearanceStart::kDetector && !knows_boxes) {
    throw ModelError(result.path_,
                     "was trained on objects that the face detector does not find: option 'start' "
                     "must be search");
  }
  if (options.start == AppearanceStart::kLandmarks) {
    result.landmarks_ = landmarks ? std::move(landmarks)
                                  : std::make_shared<const LandmarkTracker>(
                                        LandmarkTracker::load(models, options.landmarks));
    const int points = result.landmarks_->model().points();
    if (points != result.model_->points()) {
      throw ModelError(result.path_,
                       fmt::format("has {} points, the landmark tracker {}: option 'start' must be "
                                   "detector or search",
                                   result.model_->points(), points));
    }
  } else if (options.start != AppearanceStart::kSearch && knows_boxes) {
    result.detector_ = std::make_shared<const DetectorModel>(
        DetectorModel::load(models, options.landmarks.detector, options.landmarks.finder));
  }
  return result;
}

appearance::FindStarts AppearanceTracker::find_starts() const {
  const int count = options_.starts;
  if (landmarks_) {
    const auto state = std::make_shared<LandmarkState>();
    return [tracker = landmarks_, state, count](const cv::Mat& image) {
      Frame frame;
      frame.image = image;
      frame.still = true;
      Starts starts;
      for (const landmarks::TrackedFace& face : tracker->process(frame, *state).faces)
        starts.push_back(appearance::starts_around(face.points, count));
      return starts;
    };
  }
  if (detector_) {
    const auto finder = std::make_shared<landmarks::FaceFinder>(detector_->make_finder());
    return [finder, model = model_, count](const cv::Mat& image) {
      cv::Mat gray;
      Starts starts;
      for (const landmarks::Candidate& candidate : finder->find(gray_of(image, gray)))
        starts.push_back(
            appearance::starts_around(appearance::start_in_box(*model, candidate.box), count));
      return starts;
    };
  }
  const auto workspace = std::make_shared<appearance::FitWorkspace>();
  return [fitter = fitter_, model = model_, workspace](const cv::Mat& image) {
    Starts starts;
    if (const auto start = appearance::search_start(*fitter, image, {}, *workspace))
      starts.push_back({*start});
    return starts;
  };
}

std::vector<appearance::TrackedObject> AppearanceTracker::process(const Frame& frame,
                                                                  AppearanceState& state) const {
  if (!state.find) state.find = find_starts();
  const std::string source = source_of(frame);
  if (frame.still || source != state.source) redetect(state);
  state.source = source;
  if (frame.still)
    return appearance::find_objects(*fitter_, state.find, frame.image, options_.tracker.max_objects,
                                    state.workspace);
  return appearance::track_objects(*fitter_, options_.tracker, state.find, state.track, frame.image,
                                   frame.time);
}

void redetect(AppearanceState& state) { state.track = {}; }

}  // namespace tarsier::face
