// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/planar/image_targets/train.h"
#include "tarsier/planar/pipelines/target_tracker.h"

#include "ui/frame_session.h"
#include <optional>
#include <string>
#include <vector>

namespace tarsier {

enum class TargetOverlay { kOutline, kAxes, kBox, kNone };

struct TargetSessionOptions {
  planar::image_targets::TrainOptions train;  // for targets trained in the session
  // Axes and box need a camera; else the outline is drawn.
  TargetOverlay overlay = TargetOverlay::kBox;
  DebugSink* debug = nullptr;  // receives each stage; must outlive the session
  void check() const;          // throws std::invalid_argument
};

// Shows the targets found by a planar::TargetTracker.
// The left button draws a rectangle over a print that faces the camera; its content is trained at
// once and tracked from then on. Keys: t trains the middle half of the image, d re-detects all
// targets, c removes the targets trained in the session, v what is drawn, space pauses, h help, q
// or Esc quits.
// State: {"targets": [{"id", "name", "corners"}], "trained": number, "message", "draw", "paused"}.
class TargetSession final : public FrameSession {
 public:
  // on_frame() throws InputError if the camera was calibrated for images of another aspect ratio.
  explicit TargetSession(planar::TargetTracker tracker, TargetSessionOptions options = {});

  // The result of the latest frame.
  [[nodiscard]] const planar::TargetResult& result() const { return result_; }

 private:
  void process(const Frame& frame) override;
  void draw(cv::Mat& image) override;
  void draw_shown(cv::Mat& image) override;
  [[nodiscard]] nlohmann::json state() const override;
  [[nodiscard]] std::string status() const override;
  [[nodiscard]] std::vector<Action> own_actions() const override;
  bool act(const std::string& name) override;
  bool mouse(const Event& event) override;
  // Returns false if the content of the box cannot be trained.
  bool train(cv::Rect box);
  // Continues with other targets, which are detected in the next frame.
  void change(std::vector<planar::image_targets::Target> targets);
  void draw_target(cv::Mat& image, const planar::image_targets::TrackedTarget& seen) const;

  planar::TargetTracker tracker_;
  std::size_t
      initial_target_count_;  // number of targets that were not trained here; they come first
  TargetSessionOptions options_;
  planar::TargetState state_;
  planar::TargetResult result_;
  std::optional<cv::Point> drag_;  // first corner of the rectangle
  cv::Point mouse_;
  std::string message_;
};

}  // namespace tarsier
