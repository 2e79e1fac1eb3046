// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/landmarks/tracker.h"
#include "tarsier/session/overlay.h"
#include "tarsier/session/session.h"

#include <string>
#include <vector>

namespace tarsier {

// Finds the points of the faces it is shown. Faces of a still are found anew; those of a film or
// camera are followed.
// Keys: d looks for faces anew, n numbers, s smoothing, space pauses, h help, q or Esc ends.
// State: {"faces": number, "ids": [..], "smoothing", "paused"}.
class LandmarkSession final : public Session {
 public:
  // `model` must outlive the session, and so must `debug`, which takes each stage. Throws
  // std::invalid_argument for bad options.
  LandmarkSession(const landmarks::LandmarkModel& model, const landmarks::FitOptions& fit,
                  landmarks::FaceFinder finder, const landmarks::TrackerOptions& options,
                  DebugSink* debug = nullptr);

  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  // Of the latest frame.
  [[nodiscard]] const std::vector<landmarks::TrackedFace>& faces() const { return faces_; }
  [[nodiscard]] bool follows() const { return !still_; }
  [[nodiscard]] double milliseconds() const { return timer_.last_ms(); }

 private:
  void draw();
  View view(bool fresh);

  const landmarks::LandmarkModel& model_;
  landmarks::FitOptions fit_;
  landmarks::FaceFinder finder_;
  landmarks::TrackerOptions options_;
  DebugSink* debug_;
  landmarks::TrackerState state_;
  landmarks::FitWorkspace workspace_;
  std::vector<landmarks::TrackedFace> faces_;
  std::string name_;  // of the source
  std::string source_;
  FrameTimer timer_;
  cv::Mat gray_;
  cv::Mat frame_;
  cv::Mat output_;
  cv::Mat shown_;
  bool still_ = true;
  bool numbers_ = false;
  bool paused_ = false;
  bool help_ = false;
  bool finished_ = false;
};

}  // namespace tarsier
