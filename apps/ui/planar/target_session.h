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
  planar::image_targets::TrainOptions train;    // of images framed on the spot
  TargetOverlay overlay = TargetOverlay::kBox;  // axes and box need a camera: else the outline
  DebugSink* debug = nullptr;                   // takes each stage; must outlive the session
  void check() const;                           // throws std::invalid_argument
};

// Shows the targets that a planar::TargetTracker finds.
// With the left button a rectangle is drawn over a print that stands squarely in the image: what
// is inside is trained on the spot and followed from then on. Keys: t trains the middle half of the
// image, d looks for all again, c forgets what was trained on the spot, v what is drawn, space
// pauses, h help, q or Esc ends.
// State: {"targets": [{"id", "name", "corners"}], "trained": number, "message", "draw", "paused"}.
class TargetSession final : public FrameSession {
 public:
  // on_frame() throws InputError where the camera is that of images of another shape.
  explicit TargetSession(planar::TargetTracker tracker, TargetSessionOptions options = {});

  // Of the latest frame.
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
  // False where nothing can be trained on what is in the box.
  bool train(cv::Rect box);
  // Goes on with other targets, which are searched in the next frame.
  void change(std::vector<planar::image_targets::Target> targets);
  void draw_target(cv::Mat& image, const planar::image_targets::TrackedTarget& seen) const;

  planar::TargetTracker tracker_;
  std::size_t given_;  // the first so many were not trained here
  TargetSessionOptions options_;
  planar::TargetState state_;
  planar::TargetResult result_;
  std::optional<cv::Point> drag_;  // where the rectangle began
  cv::Point mouse_;
  std::string message_;
};

}  // namespace tarsier
