// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/appearance/edit.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/head/head_pose.h"
#include "tarsier/head/smoothing.h"
#include "tarsier/landmarks/tracker.h"
#include "tarsier/render/mesh.h"
#include "tarsier/session/overlay.h"
#include "tarsier/session/pose_finder.h"
#include "tarsier/session/session.h"

#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier {

enum class PoseSmoothing { kNone, kMean, kOneEuro };
enum class PoseOverlay { kNone, kAxes, kBox, kHead, kObject };

struct PoseSessionOptions {
  landmarks::FitOptions fit;
  landmarks::TrackerOptions tracker;
  head::HeadPoseOptions pose;
  std::shared_ptr<const head_view::ViewModel> view;   // corrects the directions; may be null
  PoseSmoothing smoothing = PoseSmoothing::kOneEuro;  // of films
  int mean_length = 5;                                // frames, of kMean
  head::OneEuroOptions one_euro;
  PoseOverlay overlay = PoseOverlay::kAxes;
  // Of kObject: in the head's frame, mm; a head hides what is behind it.
  std::shared_ptr<const render::Mesh> object;
  // What is done to the faces, through an appearance model of 68 points that can be drawn.
  std::vector<appearance::FaceEdit> edits;
  std::shared_ptr<const appearance::AppearanceModel> appearance;
  double edit_amount = 1;                  // 0..2
  std::optional<geometry::Camera> camera;  // width 0: of any size. Empty: guessed from the picture
  double focal_px = 0;                     // in its place, 0: guessed
  void check() const;                      // throws std::invalid_argument
};

// Finds the faces of the frames and the poses of their heads. Faces of a still are found anew;
// those of a film are followed, and the shape of each head is learnt on the way.
// Keys: d looks for faces anew, v what is drawn, space pauses, h help, q or Esc ends.
// State: {"faces": number, "ids": [..], "yaw": [..], "draw", "paused"}.
class PoseSession final : public Session {
 public:
  // The models must outlive the session. `mapping`: of the head's points to the landmarks. Throws
  // std::invalid_argument for bad options and a mapping that does not fit the models.
  PoseSession(const landmarks::LandmarkModel& landmarks, const head::HeadModel& head,
              const head::LandmarkMapping& mapping, landmarks::FaceFinder finder,
              PoseSessionOptions options);

  // Throws InputError where the camera is that of pictures of another shape.
  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  // Of the latest frame.
  [[nodiscard]] const std::vector<PosedFace>& faces() const { return faces_; }
  [[nodiscard]] const geometry::Camera& camera() const { return camera_; }
  [[nodiscard]] bool follows() const { return !still_; }
  [[nodiscard]] double milliseconds() const { return timer_.last_ms(); }

 private:
  struct Person {
    explicit Person(const PoseSessionOptions& options)
        : mean(options.mean_length), one_euro(options.one_euro) {}
    head::HeadIdentity identity;
    head::MeanFilter mean;
    head::OneEuroFilter one_euro;
    double seen = 0;  // s
  };

  [[nodiscard]] geometry::Camera camera_for(const Frame& frame) const;
  void find(const Frame& frame);
  void draw();
  void draw_object(const PosedFace& face);
  void edit_face(const PosedFace& face);
  View view(bool fresh);

  PoseFinder heads_;
  landmarks::FaceFinder finder_;
  PoseSessionOptions options_;
  std::optional<appearance::Synthesis> synthesis_;  // where faces are edited
  std::vector<std::array<int, 3>> surface_;         // triangles of the head that hides things
  landmarks::TrackerState state_;
  landmarks::FitWorkspace workspace_;
  std::map<int, Person> persons_;  // by id
  geometry::Camera camera_;
  std::vector<PosedFace> faces_;
  std::string name_;
  std::string source_;
  FrameTimer timer_;
  cv::Mat gray_;
  cv::Mat frame_;
  cv::Mat output_;
  cv::Mat shown_;
  bool still_ = true;
  bool paused_ = false;
  bool help_ = false;
  bool finished_ = false;
};

// The faces' part of a JSON line: landmarks::faces_json with "rotation" (9 numbers, row-major,
// R_camera_from_head), "translation" (mm), "yaw", "pitch", "roll" (degrees, see head/angles.h) and
// "rms_px"; without a pose, "reason".
[[nodiscard]] nlohmann::ordered_json posed_faces_json(const std::vector<PosedFace>& faces,
                                                      bool with_ids);

}  // namespace tarsier
