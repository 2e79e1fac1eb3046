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

// Where fits of an appearance model begin.
enum class AppearanceStart {
  kAuto,       // kDetector where the model knows the detector's boxes, else kSearch
  kDetector,   // the mean shape in the boxes of faces
  kLandmarks,  // the points that a landmark tracker finds, of the same markup
  kSearch,     // the whole image: of anything, and slow
};

struct AppearanceTrackerOptions {
  std::string model;  // file of `aam train`; empty: aam68.json of the store
  AppearanceStart start = AppearanceStart::kAuto;
  int starts = 1;                    // fits around each start, of which the best stays; 1..100
  LandmarkTrackerOptions landmarks;  // what finds the faces, and of kLandmarks their points
  appearance::FitOptions fit{.method = appearance::Method::kAlternating};
  appearance::TrackOptions tracker;
  void check() const;  // throws std::invalid_argument that names the value
};

// What is known from earlier frames of a video, and buffers: one for each stream of frames, always
// of the same tracker.
struct AppearanceState {
  appearance::Track track;
  appearance::FitWorkspace workspace;
  appearance::FindStarts find;  // made with the first frame
  std::string source;           // that the frames are from
};

// Fits an appearance model to the faces, or other objects, of images, and follows them in videos:
//
//   const auto tracker = face::AppearanceTracker::load(ModelStore::find());
//   face::AppearanceState state;
//   const auto source = open_source("0");  // a camera
//   while (const auto frame = source->next(1s, {}))
//     for (const auto& object : tracker.process(*frame, state))
//       fmt::print("face {}: {:.0f} % of its texture explained\n", object.id,
//                  100 * (1 - object.fit.error));
//
// Const: copies share the models, and any number of threads may use it, each with a state of its
// own.
class AppearanceTracker {
 public:
  // `landmarks`: the tracker of AppearanceStart::kLandmarks, where there is one already. Throws
  // ModelError (missing, broken, or a start that the model cannot have), std::invalid_argument
  // (options).
  [[nodiscard]] static AppearanceTracker load(
      const ModelStore& models, const AppearanceTrackerOptions& options = {},
      std::shared_ptr<const LandmarkTracker> landmarks = nullptr);

  [[nodiscard]] const appearance::AppearanceModel& model() const { return *model_; }
  [[nodiscard]] const std::string& path() const { return path_; }  // of the model
  [[nodiscard]] const appearance::Fitter& fitter() const { return *fitter_; }
  // Of one thread. Refers to the tracker's models, which it keeps.
  [[nodiscard]] appearance::FindStarts find_starts() const;

  // `frame.image`: CV_8UC3 (BGR) or CV_8UC1. Objects of a still are found for themselves, numbered
  // from 1; those of a video are followed until another source begins.
  [[nodiscard]] std::vector<appearance::TrackedObject> process(const Frame& frame,
                                                               AppearanceState& state) const;

 private:
  AppearanceTracker() = default;

  AppearanceTrackerOptions options_;
  std::string path_;
  std::shared_ptr<const appearance::AppearanceModel> model_;
  std::shared_ptr<const appearance::Fitter> fitter_;
  std::shared_ptr<const DetectorModel> detector_;     // of kDetector
  std::shared_ptr<const LandmarkTracker> landmarks_;  // of kLandmarks
};

// Forgets all places: objects are searched in the next frame.
void redetect(AppearanceState& state);

}  // namespace tarsier::face
