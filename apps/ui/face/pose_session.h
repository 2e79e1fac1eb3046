// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/face/appearance/edit.h"
#include "tarsier/face/pipelines/pose_tracker.h"
#include "tarsier/render/mesh.h"

#include "ui/frame_session.h"
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace tarsier {

enum class PoseOverlay { kNone, kAxes, kBox, kHead, kObject };

// What the session draws.
struct PoseSessionOptions {
  PoseOverlay overlay = PoseOverlay::kAxes;
  // For kObject: in the head's frame, mm; a head occludes what is behind it.
  std::shared_ptr<const render::Mesh> object;
  // Edits of the faces, through a drawable appearance model of 68 points.
  std::vector<face::appearance::FaceEdit> edits;
  std::shared_ptr<const face::appearance::AppearanceModel> appearance;
  double edit_amount = 1;

  [[nodiscard]] OptionFields fields() { return {{"edit_amount", edit_amount, range(0, 2)}}; }
  void check() const;  // throws std::invalid_argument
};

// Shows the head poses that a face::PoseTracker finds. on_frame() throws InputError if the camera
// was calibrated for images of another aspect ratio.
// Keys: d re-detects faces, v what is drawn, space pauses, h help, q or Esc quits.
// State: {"faces": number, "ids": [..], "yaw": [..], "draw", "paused"}.
class PoseSession final : public FrameSession {
 public:
  // `debug` may be null and must outlive the session. It receives the stages of each frame. Throws
  // std::invalid_argument for invalid options, and for an appearance model with other points.
  PoseSession(face::PoseTracker tracker, PoseSessionOptions options, DebugSink* debug = nullptr);

  // The result of the latest frame.
  [[nodiscard]] const face::PoseResult& result() const { return result_; }
  [[nodiscard]] const std::vector<face::PosedFace>& faces() const { return result_.faces; }
  [[nodiscard]] const geometry::Camera& camera() const { return result_.camera; }

 private:
  [[nodiscard]] const face::head::HeadModel& head_model() const;
  void process(const Frame& frame) override;
  void draw(cv::Mat& image) override;
  void draw_object(cv::Mat& image, const face::PosedFace& face) const;
  void edit_face(cv::Mat& image, const face::PosedFace& face) const;
  [[nodiscard]] nlohmann::json state() const override;
  [[nodiscard]] std::string status() const override;
  [[nodiscard]] std::vector<Action> own_actions() const override;
  bool act(const std::string& name) override;

  face::PoseTracker tracker_;
  PoseSessionOptions options_;
  DebugSink* debug_;
  std::optional<face::appearance::Synthesis> synthesis_;  // if faces are edited
  face::PoseState state_;
  face::PoseResult result_;
};

}  // namespace tarsier
