// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/face/head/head_model.h"
#include "tarsier/face/head/head_pose.h"
#include "tarsier/face/head/smoothing.h"
#include "tarsier/face/head_view/view_model.h"
#include "tarsier/face/pipelines/appearance_tracker.h"
#include "tarsier/face/pipelines/detector_model.h"
#include "tarsier/face/pipelines/landmark_tracker.h"
#include "tarsier/face/pipelines/pose_finder.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/media/frame.h"
#include "tarsier/media/model_store.h"

#include <map>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::face {

// How the poses of a tracked head are smoothed.
enum class PoseSmoothing { kNone, kMean, kOneEuro };

// What finds the points from which poses are computed.
enum class PoseFit {
  // The landmark tracker, with a second fit from the head's first pose.
  kLandmarks,
  // An active appearance model, started from the landmark tracker's points for a new face.
  kAam,
};

struct PoseTrackerOptions {
  LandmarkTrackerOptions landmarks;
  PoseFit fit = PoseFit::kLandmarks;
  // For kAam: file of `aam train`; empty: aam68.json of the store.
  std::string appearance;
  std::string head;  // file of `pose train-head`; empty: head.json of the store
  // File that maps each head point to a landmark; empty: the mapping in the head model.
  std::string mapping;
  // Whether a view model (the appearance of whole heads) corrects the directions.
  bool refine = true;
  // File of the view model (`pose train-view`). Empty: head-view.json of the store, but only if it
  // exists, the landmark tracker finds the points, and head, mapping and landmark model are those
  // of the store. Other models have other errors.
  std::string view;
  head::HeadPoseOptions pose;
  PoseSmoothing smoothing = PoseSmoothing::kOneEuro;
  int mean_length = 5;  // for kMean: frames, 1..1000
  head::OneEuroOptions one_euro;
  // Width 0: for images of any size. Empty: the camera is guessed from the image.
  std::optional<geometry::Camera> camera;
  double focal_px = 0;  // of the guessed camera; 0: guessed
  // Throws std::invalid_argument that names the value.
  void check() const;
};

// All models that are read; const and shared.
struct PoseModels {
  LandmarkTracker landmarks;
  std::shared_ptr<const head::HeadModel> head;
  head::LandmarkMapping mapping;                     // from the head's points to the landmarks
  std::shared_ptr<const head_view::ViewModel> view;  // may be null
  std::optional<AppearanceTracker> appearance;       // for kAam
};
// Throws ModelError, InputError (the mapping's file), UsageError (models that do not fit together),
// std::invalid_argument (options).
[[nodiscard]] PoseModels load_pose_models(const ModelStore& models,
                                          const PoseTrackerOptions& options = {});

// The heads of one frame.
struct PoseResult {
  std::vector<PosedFace> faces;
  geometry::Camera camera;  // camera of the poses
  bool tracked = false;     // frame of a video: ids are kept over frames
  double ms = 0;            // duration of process(), milliseconds
};

// The faces as in landmarks::faces_json. Each face with a pose also has "rotation" (9 numbers,
// row-major, R_camera_from_head), "translation" (mm), "yaw", "pitch", "roll" (degrees, see
// head/angles.h), "yaw_sigma_deg", "pitch_sigma_deg", "roll_sigma_deg" (their standard deviations,
// degrees), "sigma_floor_deg" (the part of these that is the floor of HeadPose: yaw, pitch, roll)
// and "rms_px". A face without a pose has "reason" instead.
[[nodiscard]] nlohmann::ordered_json posed_faces_json(const std::vector<PosedFace>& faces,
                                                      bool with_ids);
// {"faces": posed_faces_json(), "ms"}
[[nodiscard]] nlohmann::ordered_json to_json(const PoseResult& result);

// What is known from earlier frames of a video, and buffers. Each stream of frames needs its own
// state, always used with the same tracker.
struct PoseState {
  struct Person {
    explicit Person(const PoseTrackerOptions& options)
        : mean(options.mean_length), one_euro(options.one_euro) {}
    head::HeadIdentity identity;
    head::MeanFilter mean;
    head::OneEuroFilter one_euro;
    double last_seen_s = 0;
  };
  LandmarkState landmarks;
  AppearanceState appearance;
  std::map<int, Person> persons;  // by id of the face
};

// Estimates the 3D poses of heads in images and videos. In a video, the shape of each tracked head
// is learned from its frames:
//
//   const auto tracker = face::PoseTracker::load(ModelStore::find());
//   face::PoseState state;
//   const auto source = open_source("0");  // a camera
//   while (const auto frame = source->next(1s, {}))
//     for (const face::PosedFace& face : tracker.process(*frame, state).faces)
//       if (face.pose) fmt::print("yaw {:.0f} degrees\n", face.pose->angles.yaw_deg);
//
// A tracker is const and thread-safe; each thread needs its own state. Copies share the models.
class PoseTracker {
 public:
  // Throws as load_pose_models().
  [[nodiscard]] static PoseTracker load(const ModelStore& models,
                                        const PoseTrackerOptions& options = {});
  // Uses models that are already loaded. Throws std::invalid_argument for bad options and for a
  // mapping that does not fit the models.
  PoseTracker(const PoseModels& models, const PoseTrackerOptions& options);

  [[nodiscard]] const PoseFinder& finder() const { return finder_; }
  [[nodiscard]] const LandmarkTracker& landmarks() const { return landmarks_; }

  // `frame.image`: CV_8UC3 (BGR) or CV_8UC1. In a still, heads are detected independently and
  // numbered from 1. In a video, they are tracked until another source begins. Throws InputError if
  // the camera belongs to images of another shape. `debug`, which may be null, receives the stages
  // of LandmarkTracker and PoseFinder.
  //
  // With PoseFit::kAam, a face's "score" is the share of its texture that the model explains, and
  // the visibility of its points is unknown.
  [[nodiscard]] PoseResult process(const Frame& frame, PoseState& state,
                                   DebugSink* debug = nullptr) const;

 private:
  [[nodiscard]] geometry::Camera camera_for(const Frame& frame) const;
  [[nodiscard]] std::vector<PosedFace> faces_of_still(const Frame& frame,
                                                      const geometry::Camera& camera,
                                                      PoseState& state, DebugSink* debug) const;
  [[nodiscard]] std::vector<PosedFace> faces_of_video(const Frame& frame,
                                                      const geometry::Camera& camera,
                                                      PoseState& state, DebugSink* debug) const;

  LandmarkTracker landmarks_;
  std::optional<AppearanceTracker> appearance_;
  PoseFinder finder_;
  PoseTrackerOptions options_;
};

// Forgets all positions and the learned shapes of heads: the next frame is searched as a whole.
void redetect(PoseState& state);

}  // namespace tarsier::face
