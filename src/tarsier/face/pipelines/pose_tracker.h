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

// What finds the points that poses are of.
enum class PoseFit {
  kLandmarks,  // the landmark tracker, fitted a second time from the head's first pose
  kAam,        // an active appearance model, from the landmark tracker's points where a face is new
};

struct PoseTrackerOptions {
  LandmarkTrackerOptions landmarks;
  PoseFit fit = PoseFit::kLandmarks;
  std::string appearance;  // of kAam: file of `aam train`; empty: aam68.json of the store
  std::string head;        // file of `pose train-head`; empty: head.json of the store
  std::string mapping;     // file: which landmark each head point is; empty: the head's own
  // Whether a model of how whole heads look corrects the directions.
  bool refine = true;
  // Its file (`pose train-view`); empty: head-view.json of the store, if it is there, the landmark
  // tracker finds the points, and head, mapping and landmark model are those of the store too:
  // others err in other ways.
  std::string view;
  head::HeadPoseOptions pose;
  PoseSmoothing smoothing = PoseSmoothing::kOneEuro;
  int mean_length = 5;  // frames, of kMean; 1..1000
  head::OneEuroOptions one_euro;
  std::optional<geometry::Camera> camera;  // width 0: of any size. Empty: guessed from the image
  double focal_px = 0;                     // of the guessed camera; 0: guessed, too
  void check() const;                      // throws std::invalid_argument that names the value
};

// All that is read; const and shared.
struct PoseModels {
  LandmarkTracker landmarks;
  std::shared_ptr<const head::HeadModel> head;
  head::LandmarkMapping mapping;                     // of the head's points to the landmarks
  std::shared_ptr<const head_view::ViewModel> view;  // may be null
  std::optional<AppearanceTracker> appearance;       // of kAam
};
// Throws ModelError, InputError (the mapping's file), UsageError (models that do not fit together),
// std::invalid_argument (options).
[[nodiscard]] PoseModels load_pose_models(const ModelStore& models,
                                          const PoseTrackerOptions& options = {});

// The heads of one frame.
struct PoseResult {
  std::vector<PosedFace> faces;
  geometry::Camera camera;  // that the poses are in
  bool tracked = false;     // frame of a video: ids stay with their faces
  double ms = 0;            // spent in process(), milliseconds
};

// The faces as landmarks::faces_json has them, each with "rotation" (9 numbers, row-major,
// R_camera_from_head), "translation" (mm), "yaw", "pitch", "roll" (degrees, see head/angles.h),
// "yaw_sigma_deg", "pitch_sigma_deg", "roll_sigma_deg" (their standard deviations, degrees),
// "sigma_floor_deg" (how much of these is the floor of HeadPose: yaw, pitch, roll) and "rms_px";
// without a pose, "reason".
[[nodiscard]] nlohmann::ordered_json posed_faces_json(const std::vector<PosedFace>& faces,
                                                      bool with_ids);
// {"faces": posed_faces_json(), "ms"}
[[nodiscard]] nlohmann::ordered_json to_json(const PoseResult& result);

// What is known from earlier frames of a video, and buffers: one for each stream of frames, always
// of the same tracker.
struct PoseState {
  struct Person {
    explicit Person(const PoseTrackerOptions& options)
        : mean(options.mean_length), one_euro(options.one_euro) {}
    head::HeadIdentity identity;
    head::MeanFilter mean;
    head::OneEuroFilter one_euro;
    double seen = 0;  // s
  };
  LandmarkState landmarks;
  AppearanceState appearance;
  std::map<int, Person> persons;  // by id of the face
};

// The 3D poses of heads in images and videos, where the shape of each tracked head is learned on
// the way:
//
//   const auto tracker = face::PoseTracker::load(ModelStore::find());
//   face::PoseState state;
//   const auto source = open_source("0");  // a camera
//   while (const auto frame = source->next(1s, {}))
//     for (const face::PosedFace& face : tracker.process(*frame, state).faces)
//       if (face.pose) fmt::print("yaw {:.0f} degrees\n", face.pose->angles.yaw_deg);
//
// Const: copies share the models, and any number of threads may use it, each with a state of its
// own.
class PoseTracker {
 public:
  // Throws as load_pose_models().
  [[nodiscard]] static PoseTracker load(const ModelStore& models,
                                        const PoseTrackerOptions& options = {});
  // With models that are there already. Throws std::invalid_argument for bad options and a mapping
  // that does not fit the models.
  PoseTracker(const PoseModels& models, const PoseTrackerOptions& options);

  [[nodiscard]] const PoseFinder& finder() const { return finder_; }
  [[nodiscard]] const LandmarkTracker& landmarks() const { return landmarks_; }

  // `frame.image`: CV_8UC3 (BGR) or CV_8UC1. Heads of a still are found for themselves, numbered
  // from 1; those of a video are tracked until another source begins. Throws InputError where the
  // camera is that of images of another shape. `debug`, which may be null, takes the stages: those
  // of LandmarkTracker and PoseFinder.
  //
  // Of PoseFit::kAam a face's "score" is the share of its texture that the model explains, and
  // nothing is known of the visibility of its points.
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

// Forgets all places and what was learned of the heads: faces are searched in the next frame.
void redetect(PoseState& state);

}  // namespace tarsier::face
