// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/planar/augment/augment.h"
#include "tarsier/planar/pipelines/marker_tracker.h"
#include "tarsier/session/overlay.h"
#include "tarsier/session/session.h"

#include <string>
#include <vector>

namespace tarsier {

struct ArSessionOptions {
  planar::augment::AugmentOptions augment;  // `mesh` may be set whatever is drawn first
  bool outlines = true;                     // frames and ids of the markers
  std::string save_folder = ".";
  DebugSink* debug = nullptr;  // takes each stage of the tracker; must outlive the session
  void check() const;          // throws std::invalid_argument
};

// Draws objects on the markers that a planar::MarkerTracker finds.
// Keys: a axes, c cube, m the mesh, n nothing; i outlines and ids; e shadows; s smoothing; l the
// list of markers with their distances; f the next family; w saves the picture; space freezes, also
// to look at one picture with other objects on it; h help; q or Esc ends.
// State: {"markers": number, "ids": [..], "distance_m": [..], "draw", "outlines", "shadow",
// "smooth", "list", "family", "saved", "paused"}.
class ArSession final : public Session {
 public:
  explicit ArSession(planar::MarkerTracker tracker, ArSessionOptions options = {});

  // Throws InputError where the camera is that of pictures of another shape.
  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  // Of the latest frame.
  [[nodiscard]] const planar::MarkerResult& result() const { return result_; }

 private:
  void find();
  void draw();
  void draw_outlines();
  void draw_list();
  void save();
  // The tracker with other options; with `again` what was known is forgotten.
  void change(const planar::MarkerTrackerOptions& options, bool again);
  void next_family();
  View view(bool fresh);

  ArSessionOptions options_;
  planar::MarkerTracker tracker_;
  planar::MarkerState state_;
  planar::MarkerResult result_;
  planar::augment::AugmentState augment_;
  Frame frame_;
  cv::Mat output_;
  cv::Mat shown_;
  std::string source_;
  std::string saved_;
  std::string message_;
  double message_since_ = 0;
  FrameTimer timer_;
  bool list_ = false;
  bool paused_ = false;
  bool help_ = false;
  bool finished_ = false;
};

}  // namespace tarsier
