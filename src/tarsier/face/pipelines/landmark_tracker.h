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
  // File of `landmarks train tracker`; empty: landmarks68.json of the store.
  std::string model;
  std::string detector;  // see DetectorModel::load()
  landmarks::FaceFinderOptions finder;
  landmarks::FitOptions fit;  // no method: the best one that the model has
  landmarks::TrackerOptions tracker;
  void check() const;  // throws std::invalid_argument that names the value
};

// The faces of one frame.
struct LandmarkResult {
  std::vector<landmarks::TrackedFace> faces;  // points in px
  bool tracked = false;  // frame of a video: ids are kept over frames; otherwise they count from 1
  double ms = 0;         // duration of process(), milliseconds
};

// {"faces": landmarks::faces_json(), "ms"}: the line of `tarsier landmarks track --json` without
// the image's name.
[[nodiscard]] nlohmann::ordered_json to_json(const LandmarkResult& result);

// What is known from earlier frames of a video, and buffers. Each stream of frames needs its own
// state, always used with the same tracker.
struct LandmarkState {
  landmarks::TrackerState tracker;
  landmarks::FitWorkspace workspace;
  std::optional<landmarks::FaceFinder> finder;  // created with the first frame
  std::string source;                           // source of the frames
  cv::Mat gray;
};

// Detects the faces of images and their landmarks, and tracks them in videos:
//
//   const auto tracker = face::LandmarkTracker::load(ModelStore::find());
//   face::LandmarkState state;
//   const auto source = open_source("0");  // a camera
//   while (const auto frame = source->next(1s, {}))
//     for (const landmarks::TrackedFace& face : tracker.process(*frame, state).faces)
//       fmt::print("face {}: left eye at {:.0f} {:.0f}\n", face.id, face.points(0, 36),
//                  face.points(1, 36));
//
// A tracker is const and thread-safe; each thread needs its own state. Copies share the models.
class LandmarkTracker {
 public:
  // Throws ModelError (missing, broken, or without the requested method), std::invalid_argument
  // (options).
  [[nodiscard]] static LandmarkTracker load(const ModelStore& models,
                                            const LandmarkTrackerOptions& options = {});
  // Uses models that are already loaded. The files that `options` names are not read.
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

  // `frame.image`: CV_8UC3 (BGR) or CV_8UC1. In a still, faces are detected independently. In a
  // video, they are tracked until another source begins. `debug`, which may be null, receives the
  // stages.
  [[nodiscard]] LandmarkResult process(const Frame& frame, LandmarkState& state,
                                       DebugSink* debug = nullptr) const;

 private:
  std::shared_ptr<const landmarks::LandmarkModel> model_;
  DetectorModel detector_;
  landmarks::FitOptions fit_;
  landmarks::TrackerOptions tracking_;
};

// Forgets all positions: the next frame is searched as a whole. Numbering of ids continues.
void redetect(LandmarkState& state);

// Converts CV_8UC3 (BGR) to CV_8UC1 in `gray`; a CV_8UC1 image is returned as it is. Throws
// std::invalid_argument for other images.
[[nodiscard]] const cv::Mat& gray_of(const cv::Mat& image, cv::Mat& gray);

}  // namespace tarsier::face
