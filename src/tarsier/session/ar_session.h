// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/planar/augment/augment.h"
#include "tarsier/planar/markers/pose.h"
#include "tarsier/session/overlay.h"
#include "tarsier/session/session.h"

#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier {

enum class MarkerBackend { kOwn, kOpencv };

struct ArSessionOptions {
  std::string family = "36h11";
  double size = 0.05;  // m, of the markers over their black frame, > 0
  MarkerBackend backend = MarkerBackend::kOwn;
  planar::markers::DetectOptions detect;
  geometry::PlanarTrackOptions track;       // of videos; `smooth` is set by the key too
  std::optional<geometry::Camera> camera;   // empty: guessed from the picture's size
  double focal_px = 0;                      // in its place; 0: the picture's larger side
  planar::augment::AugmentOptions augment;  // `mesh` may be set whatever is drawn first
  bool outlines = true;                     // frames and ids of the markers
  std::string save_folder = ".";
  DebugSink* debug = nullptr;  // takes each stage of our own backend; must outlive the session
  void check() const;          // throws std::invalid_argument; UsageError for an unknown family
};

// Finds the markers of the frames and draws things on them. The markers of a still are posed alone;
// in a video each has its track.
// Keys: a axes, c cube, m the mesh, n nothing; i outlines and ids; e shadows; s smoothing; l the
// list of markers with their distances; f the next family; w saves the picture; space freezes, also
// to look at one picture with other things on it; h help; q or Esc ends.
// State: {"markers": number, "ids": [..], "distance_m": [..], "draw", "outlines", "shadow",
// "smooth", "list", "family", "saved", "paused"}.
class ArSession final : public Session {
 public:
  explicit ArSession(ArSessionOptions options);

  // Throws InputError where the camera is that of pictures of another shape.
  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  // Of the latest frame.
  [[nodiscard]] const std::vector<planar::markers::PosedMarker>& markers() const {
    return markers_;
  }
  [[nodiscard]] const geometry::Camera& camera() const { return camera_; }
  [[nodiscard]] double milliseconds() const { return timer_.last_ms(); }  // to find and to pose

 private:
  void find(const Frame& frame);
  void draw();
  void draw_outlines();
  void draw_list();
  void save();
  void set_family(const std::string& name);
  [[nodiscard]] geometry::Camera camera_for(const Frame& frame) const;
  View view(bool fresh);

  ArSessionOptions options_;
  const planar::markers::Dictionary* family_;
  planar::markers::DetectWorkspace workspace_;
  planar::markers::MarkerTracker tracker_;
  planar::augment::AugmentState augment_;
  geometry::Camera camera_;
  std::vector<planar::markers::PosedMarker> markers_;
  Frame frame_;
  cv::Mat gray_;
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

// [{"id","corners","rvec","tvec","errors","margin","ambiguity"}]: errors are those of the pose and,
// where there is one, of the other (px, rms). Without a pose only id, corners and margin.
[[nodiscard]] nlohmann::ordered_json posed_markers_json(
    const std::vector<planar::markers::PosedMarker>& markers);

}  // namespace tarsier
