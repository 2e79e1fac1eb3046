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
  // `mesh` may be set even if something else is drawn first
  planar::augment::AugmentOptions augment;
  bool outlines = true;  // outlines and ids of the markers
  std::string save_folder = ".";
  DebugSink* debug = nullptr;  // receives each stage of the tracker; must outlive the session
  void check() const;          // throws std::invalid_argument
};

// Draws objects on the markers found by a planar::MarkerTracker.
// Keys: a axes, c cube, m the mesh, n nothing; i outlines and ids; e shadows; s smoothing; l the
// list of markers with their distances; f the next family; w saves the image; space pauses, for
// example to try other objects on one image; h help; q or Esc quits.
// State: {"markers": number, "ids": [..], "distance_m": [..], "draw", "outlines", "shadow",
// "smooth", "list", "family", "saved", "paused"}; with a board: "board_m": its distance or null.
class ArSession final : public FrameSession {
 public:
  // on_frame() throws InputError if the camera was calibrated for images of another aspect ratio.
  explicit ArSession(planar::MarkerTracker tracker, ArSessionOptions options = {});

  // The result of the latest frame.
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
  // Changes the tracker's options; `resets_state` drops the tracker's state.
  void change(const planar::MarkerTrackerOptions& options, bool resets_state);
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
