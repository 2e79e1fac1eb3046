// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/face/pipelines/landmark_tracker.h"
#include "tarsier/session/overlay.h"
#include "tarsier/session/session.h"

#include <string>

namespace tarsier {

// Shows what a face::LandmarkTracker finds.
// Keys: d looks for faces again, n numbers, s smoothing, space pauses, h help, q or Esc ends.
// State: {"faces": number, "ids": [..], "smoothing", "paused"}.
class LandmarkSession final : public Session {
 public:
  // `debug`, which may be null and must outlive the session, takes each stage.
  explicit LandmarkSession(face::LandmarkTracker tracker, DebugSink* debug = nullptr);

  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  // Of the latest frame.
  [[nodiscard]] const face::LandmarkResult& result() const { return result_; }

 private:
  void draw();
  View view(bool fresh);

  face::LandmarkTracker tracker_;
  DebugSink* debug_;
  face::LandmarkState state_;
  face::LandmarkResult result_;
  std::string source_;
  FrameTimer timer_;
  cv::Mat frame_;
  cv::Mat output_;
  cv::Mat shown_;
  bool numbers_ = false;
  bool paused_ = false;
  bool help_ = false;
  bool finished_ = false;
};

}  // namespace tarsier
