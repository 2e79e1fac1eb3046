// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/face/pipelines/landmark_tracker.h"

#include "ui/frame_session.h"
#include <string>

namespace tarsier {

// Shows the landmarks that a face::LandmarkTracker finds.
// Keys: d re-detects faces, n numbers, s smoothing, space pauses, h help, q or Esc quits.
// State: {"faces": number, "ids": [..], "smoothing", "paused"}.
class LandmarkSession final : public FrameSession {
 public:
  // `debug` may be null and must outlive the session. It receives each stage.
  explicit LandmarkSession(face::LandmarkTracker tracker, DebugSink* debug = nullptr);

  // The result of the latest frame.
  [[nodiscard]] const face::LandmarkResult& result() const { return result_; }

 private:
  void process(const Frame& frame) override;
  void draw(cv::Mat& image) override;
  [[nodiscard]] nlohmann::json state() const override;
  [[nodiscard]] std::string status() const override;
  [[nodiscard]] std::vector<Action> own_actions() const override;
  bool act(const std::string& name) override;

  face::LandmarkTracker tracker_;
  DebugSink* debug_;
  face::LandmarkState state_;
  face::LandmarkResult result_;
  bool numbers_ = false;
  bool sigmas_ = false;
};

}  // namespace tarsier
