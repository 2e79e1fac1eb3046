// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/appearance/edit.h"
#include "tarsier/face/pipelines/pose_tracker.h"
#include "tarsier/render/mesh.h"
#include "tarsier/session/overlay.h"
#include "tarsier/session/session.h"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace tarsier {

enum class PoseOverlay { kNone, kAxes, kBox, kHead, kObject };

// What is drawn.
struct PoseSessionOptions {
  PoseOverlay overlay = PoseOverlay::kAxes;
  // Of kObject: in the head's frame, mm; a head hides what is behind it.
  std::shared_ptr<const render::Mesh> object;
  // What is done to the faces, through an appearance model of 68 points that can be drawn.
  std::vector<face::appearance::FaceEdit> edits;
  std::shared_ptr<const face::appearance::AppearanceModel> appearance;
  double edit_amount = 1;  // 0..2
  void check() const;      // throws std::invalid_argument
};

// Shows the poses of heads that a face::PoseTracker finds.
// Keys: d looks for faces again, v what is drawn, space pauses, h help, q or Esc ends.
// State: {"faces": number, "ids": [..], "yaw": [..], "draw", "paused"}.
class PoseSession final : public Session {
 public:
  // Throws std::invalid_argument for bad options, and an appearance model of other points.
  PoseSession(face::PoseTracker tracker, PoseSessionOptions options);

  // Throws InputError where the camera is that of pictures of another shape.
  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  // Of the latest frame.
  [[nodiscard]] const face::PoseResult& result() const { return result_; }
  [[nodiscard]] const std::vector<face::PosedFace>& faces() const { return result_.faces; }
  [[nodiscard]] const geometry::Camera& camera() const { return result_.camera; }

 private:
  [[nodiscard]] const face::head::HeadModel& head_model() const;
  void draw();
  void draw_object(const face::PosedFace& face);
  void edit_face(const face::PosedFace& face);
  View view(bool fresh);

  face::PoseTracker tracker_;
  PoseSessionOptions options_;
  std::optional<face::appearance::Synthesis> synthesis_;  // where faces are edited
  face::PoseState state_;
  face::PoseResult result_;
  std::string source_;
  FrameTimer timer_;
  cv::Mat frame_;
  cv::Mat output_;
  cv::Mat shown_;
  bool paused_ = false;
  bool help_ = false;
  bool finished_ = false;
};

}  // namespace tarsier
