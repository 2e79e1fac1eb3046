// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/planar/image_targets/train.h"
#include "tarsier/planar/pipelines/target_tracker.h"
#include "tarsier/session/overlay.h"
#include "tarsier/session/session.h"

#include <optional>
#include <string>
#include <vector>

namespace tarsier {

enum class TargetOverlay { kOutline, kAxes, kBox, kNone };

struct TargetSessionOptions {
  planar::image_targets::TrainOptions train;    // of pictures framed on the spot
  TargetOverlay overlay = TargetOverlay::kBox;  // axes and box need a camera: else the outline
  DebugSink* debug = nullptr;                   // takes each stage; must outlive the session
  void check() const;                           // throws std::invalid_argument
};

// Shows the targets that a planar::TargetTracker finds.
// With the left button a rectangle is drawn over a print that stands squarely in the picture: what
// is inside is trained on the spot and followed from then on. Keys: t trains the middle half of the
// picture, d looks for all again, c forgets what was trained on the spot, v what is drawn, space
// pauses, h help, q or Esc ends.
// State: {"targets": [{"id", "name", "corners"}], "trained": number, "message", "draw", "paused"}.
class TargetSession final : public Session {
 public:
  explicit TargetSession(planar::TargetTracker tracker, TargetSessionOptions options = {});

  // Throws InputError where the camera is that of pictures of another shape.
  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  // Of the latest frame.
  [[nodiscard]] const planar::TargetResult& result() const { return result_; }

 private:
  void on_mouse(const Event& event);
  void train(cv::Rect box);
  void find();
  // Goes on with other targets, which are searched in the next frame.
  void change(std::vector<planar::image_targets::Target> targets);
  void draw();
  void draw_target(const planar::image_targets::TrackedTarget& seen);
  View view(bool fresh);

  planar::TargetTracker tracker_;
  std::size_t given_;  // the first so many were not trained here
  TargetSessionOptions options_;
  planar::TargetState state_;
  planar::TargetResult result_;
  std::optional<cv::Point> drag_;  // where the rectangle began
  cv::Point mouse_;
  std::string trouble_;
  std::string message_;
  FrameTimer timer_;
  Frame frame_;
  cv::Mat output_;
  cv::Mat shown_;
  bool paused_ = false;
  bool help_ = false;
  bool finished_ = false;
};

}  // namespace tarsier
