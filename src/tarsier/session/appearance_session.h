// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/face/appearance/synthesis.h"
#include "tarsier/face/appearance/tracker.h"
#include "tarsier/session/overlay.h"
#include "tarsier/session/session.h"

#include <optional>
#include <string>
#include <vector>

namespace tarsier {

// Fits an appearance model to what it is shown. Objects of a still are found again; those of a
// video or camera are followed. Keys: v what is drawn (mesh, the model's face over the picture,
// points, nothing), e the error picture, d looks for objects again, space pauses, h help, q or Esc
// ends. State: {"faces": number, "ids": [..], "error", "drawn", "paused"}.
class AppearanceSession final : public Session {
 public:
  enum class Drawn { kMesh, kFace, kPoints, kNothing };

  // `fitter` must outlive the session, and so must `debug`, which takes the meshes, the model's
  // faces over the picture, and of each object its texture, the model's and the difference. Throws
  // std::invalid_argument for bad options.
  AppearanceSession(const face::appearance::Fitter& fitter, face::appearance::FindStarts find,
                    const face::appearance::TrackOptions& options, Drawn drawn,
                    DebugSink* debug = nullptr);

  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  // Of the latest frame.
  [[nodiscard]] const std::vector<face::appearance::TrackedObject>& objects() const {
    return objects_;
  }
  [[nodiscard]] bool follows() const { return !still_; }
  [[nodiscard]] double milliseconds() const { return timer_.last_ms(); }

 private:
  void draw();
  void draw_object(const Eigen::Matrix2Xd& points, Drawn drawn, cv::Mat& image) const;
  void show_stages();
  View view(bool fresh);

  const face::appearance::Fitter& fitter_;
  face::appearance::FindStarts find_;
  face::appearance::TrackOptions options_;
  DebugSink* debug_;
  std::optional<face::appearance::Synthesis> synthesis_;  // where the model can be drawn
  face::appearance::Track track_;
  face::appearance::FitWorkspace workspace_;
  std::vector<face::appearance::TrackedObject> objects_;
  Drawn drawn_ = Drawn::kMesh;
  std::string name_;  // of the source
  std::string source_;
  FrameTimer timer_;
  cv::Mat frame_;
  cv::Mat output_;
  cv::Mat shown_;
  bool still_ = true;
  bool errors_ = false;
  bool paused_ = false;
  bool help_ = false;
  bool finished_ = false;
};

[[nodiscard]] std::string_view name_of(AppearanceSession::Drawn drawn);

}  // namespace tarsier
