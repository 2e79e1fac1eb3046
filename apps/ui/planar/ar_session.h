// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/planar/augment/augment.h"
#include "tarsier/planar/pipelines/marker_tracker.h"

#include "ui/frame_session.h"
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
// list of markers with their distances; f the next family; w saves the image; space pauses, also
// to look at one image with other objects on it; h help; q or Esc ends.
// State: {"markers": number, "ids": [..], "distance_m": [..], "draw", "outlines", "shadow",
// "smooth", "list", "family", "saved", "paused"}.
class ArSession final : public FrameSession {
 public:
  // on_frame() throws InputError where the camera is that of images of another shape.
  explicit ArSession(planar::MarkerTracker tracker, ArSessionOptions options = {});

  // Of the latest frame.
  [[nodiscard]] const planar::MarkerResult& result() const { return result_; }

 private:
  void process(const Frame& frame) override;
  void draw(cv::Mat& image) override;
  void draw_shown(cv::Mat& image) override;
  [[nodiscard]] nlohmann::json state() const override;
  [[nodiscard]] std::string status() const override;
  [[nodiscard]] std::string message() const override;
  [[nodiscard]] std::vector<Action> own_actions() const override;
  bool act(const std::string& name) override;
  void draw_outlines(cv::Mat& image) const;
  void save();
  // The tracker with other options; with `again` what was known is forgotten.
  void change(const planar::MarkerTrackerOptions& options, bool again);
  void next_family();
  [[nodiscard]] std::string families() const;

  ArSessionOptions options_;
  planar::MarkerTracker tracker_;
  planar::MarkerState state_;
  planar::MarkerResult result_;
  planar::augment::AugmentState augment_;
  std::string saved_;
  std::string message_;
  double message_since_ = 0;
  bool list_ = false;
};

}  // namespace tarsier
