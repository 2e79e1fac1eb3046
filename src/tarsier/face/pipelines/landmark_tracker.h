// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/landmarks/tracker.h"
#include "tarsier/face/pipelines/detector_model.h"
#include "tarsier/media/frame.h"
#include "tarsier/media/model_store.h"

#include <opencv2/core/mat.hpp>

#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::face {

struct LandmarkTrackerOptions {
  std::string model;     // file of `landmarks train tracker`; empty: landmarks68.json of the store
  std::string detector;  // see DetectorModel::load()
  landmarks::FaceFinderOptions finder;
  landmarks::FitOptions fit;  // without a method: the best that the model has
  landmarks::TrackerOptions tracker;
  void check() const;  // throws std::invalid_argument that names the value
};

// The faces of one frame.
struct LandmarkResult {
  std::vector<landmarks::TrackedFace> faces;  // points in px
  bool tracked = false;  // frame of a video: ids stay with their faces; else they count from 1
  double ms = 0;         // spent in process(), milliseconds
};

// {"faces": landmarks::faces_json(), "ms"}: the line of `tarsier landmarks track --json` without
// the image's name.
[[nodiscard]] nlohmann::ordered_json to_json(const LandmarkResult& result);

// What is known from earlier frames of a video, and buffers: one for each stream of frames, always
// of the same tracker.
struct LandmarkState {
  landmarks::TrackerState tracker;
  landmarks::FitWorkspace workspace;
  std::optional<landmarks::FaceFinder> finder;  // made with the first frame
  std::string source;                           // that the frames are from
  cv::Mat gray;
};

// Finds the faces of images and their points, and tracks them in videos:
//
//   const auto tracker = face::LandmarkTracker::load(ModelStore::find());
//   face::LandmarkState state;
//   const auto source = open_source("0");  // a camera
//   while (const auto frame = source->next(1s, {}))
//     for (const landmarks::TrackedFace& face : tracker.process(*frame, state).faces)
//       fmt::print("face {}: left eye at {:.0f} {:.0f}\n", face.id, face.points(0, 36),
//                  face.points(1, 36));
//
// Const: copies share the models, and any number of threads may use it, each with a state of its
// own.
class LandmarkTracker {
 public:
  // Throws ModelError (missing, broken, without a part for the method that was asked for),
  // std::invalid_argument (options).
  [[nodiscard]] static LandmarkTracker load(const ModelStore& models,
                                            const LandmarkTrackerOptions& options = {});
  // With models that are there already; those that `options` names are not read.
  LandmarkTracker(std::shared_ptr<const landmarks::LandmarkModel> model, DetectorModel detector,
                  const LandmarkTrackerOptions& options = {});

  [[nodiscard]] const landmarks::LandmarkModel& model() const { return *model_; }
  [[nodiscard]] const std::shared_ptr<const landmarks::LandmarkModel>& shared_model() const {
    return model_;
  }
  [[nodiscard]] const DetectorModel& detector() const { return detector_; }
  [[nodiscard]] const landmarks::FitOptions& fit() const { return fit_; }
  [[nodiscard]] const landmarks::TrackerOptions& tracking() const { return tracking_; }
  void set_tracking(const landmarks::TrackerOptions& options);

  // `frame.image`: CV_8UC3 (BGR) or CV_8UC1. Faces of a still are found for themselves; those of a
  // video are tracked until another source begins. `debug`, which may be null, takes the stages.
  [[nodiscard]] LandmarkResult process(const Frame& frame, LandmarkState& state,
                                       DebugSink* debug = nullptr) const;

 private:
  std::shared_ptr<const landmarks::LandmarkModel> model_;
  DetectorModel detector_;
  landmarks::FitOptions fit_;
  landmarks::TrackerOptions tracking_;
};

// Forgets all places: faces are searched in the next frame. Ids go on.
void redetect(LandmarkState& state);

// CV_8UC3 (BGR) or CV_8UC1 as CV_8UC1, in `gray` where it has to be converted. Throws
// std::invalid_argument for other images.
[[nodiscard]] const cv::Mat& gray_of(const cv::Mat& image, cv::Mat& gray);

}  // namespace tarsier::face
