// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/appearance/fit.h"
#include "tarsier/face/appearance/model.h"
#include "tarsier/face/appearance/tracker.h"
#include "tarsier/face/pipelines/landmark_tracker.h"
#include "tarsier/media/frame.h"
#include "tarsier/media/model_store.h"

#include <memory>
#include <string>
#include <vector>

namespace tarsier::face {

// Where the fits of an appearance model start.
enum class AppearanceStart {
  // kDetector if the model was trained on objects that the face detector finds, otherwise kSearch.
  kAuto,
  kDetector,   // the mean shape, placed in detected bounding boxes of faces
  kLandmarks,  // the points of a landmark tracker with the same markup
  kSearch,     // searches the whole image: works for any object, but is slow
};

struct AppearanceTrackerOptions {
  // File of `aam train`; empty: aam68.json of the store.
  std::string model;
  AppearanceStart start = AppearanceStart::kAuto;
  int starts = 1;                    // fits around each start, 1..100; the best one is kept
  LandmarkTrackerOptions landmarks;  // detects the faces, and for kLandmarks also their points
  appearance::FitOptions fit{.method = appearance::Method::kAlternating};
  appearance::TrackOptions tracker;
  void check() const;  // throws std::invalid_argument that names the value
};

// What is known from earlier frames of a video, and buffers. Each stream of frames needs its own
// state, always used with the same tracker.
struct AppearanceState {
  appearance::Track track;
  appearance::FitWorkspace workspace;
  appearance::FindStarts find;  // created with the first frame
  std::string source;           // source of the frames
};

// Fits an appearance model to faces or other objects in images, and tracks them in videos:
//
//   const auto tracker = face::AppearanceTracker::load(ModelStore::find());
//   face::AppearanceState state;
//   const auto source = open_source("0");  // a camera
//   while (const auto frame = source->next(1s, {}))
//     for (const auto& object : tracker.process(*frame, state))
//       fmt::print("face {}: {:.0f} % of its texture explained\n", object.id,
//                  100 * (1 - object.fit.error));
//
// A tracker is const and thread-safe; each thread needs its own state. Copies share the models.
class AppearanceTracker {
 public:
  // `landmarks`: an existing tracker for AppearanceStart::kLandmarks; null: it is loaded. Throws
  // ModelError (missing, broken, or a start that the model does not support), std::invalid_argument
  // (options).
  [[nodiscard]] static AppearanceTracker load(
      const ModelStore& models, const AppearanceTrackerOptions& options = {},
      std::shared_ptr<const LandmarkTracker> landmarks = nullptr);

  [[nodiscard]] const appearance::AppearanceModel& model() const { return *model_; }
  [[nodiscard]] const std::string& path() const { return path_; }  // file of the model
  [[nodiscard]] const appearance::Fitter& fitter() const { return *fitter_; }
  // The result belongs to one thread. It keeps the tracker's models alive.
  [[nodiscard]] appearance::FindStarts find_starts() const;

  // `frame.image`: CV_8UC3 (BGR) or CV_8UC1. In a still, objects are detected independently and
  // numbered from 1. In a video, they are tracked until another source begins.
  [[nodiscard]] std::vector<appearance::TrackedObject> process(const Frame& frame,
                                                               AppearanceState& state) const;

 private:
  AppearanceTracker() = default;

  AppearanceTrackerOptions options_;
  std::string path_;
  std::shared_ptr<const appearance::AppearanceModel> model_;
  std::shared_ptr<const appearance::Fitter> fitter_;
  std::shared_ptr<const DetectorModel> detector_;     // for kDetector
  std::shared_ptr<const LandmarkTracker> landmarks_;  // for kLandmarks
};

// Forgets all positions: the next frame is searched as a whole.
void redetect(AppearanceState& state);

}  // namespace tarsier::face
