// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/face/appearance/synthesis.h"
#include "tarsier/face/appearance/tracker.h"

#include "ui/frame_session.h"
#include <optional>
#include <string>
#include <vector>

namespace tarsier {

// Fits an appearance model to what it is shown. Objects of a still are found again; those of a
// video or camera are followed. Keys: v what is drawn (mesh, the model's face over the image,
// points, nothing), e the error image, d looks for objects again, space pauses, h help, q or Esc
// ends. State: {"faces": number, "ids": [..], "error", "drawn", "paused"}.
class AppearanceSession final : public FrameSession {
 public:
  enum class Drawn { kMesh, kFace, kPoints, kNothing };

  // `fitter` must outlive the session, and so must `debug`, which takes the meshes, the model's
  // faces over the image, and of each object its texture, the model's and the difference. Throws
  // std::invalid_argument for bad options.
  AppearanceSession(const face::appearance::Fitter& fitter, face::appearance::FindStarts find,
                    const face::appearance::TrackOptions& options, Drawn drawn,
                    DebugSink* debug = nullptr);

  // Of the latest frame.
  [[nodiscard]] const std::vector<face::appearance::TrackedObject>& objects() const {
    return objects_;
  }
  [[nodiscard]] bool follows() const { return !still(); }

 private:
  void restart() override { track_ = {}; }
  void process(const Frame& frame) override;
  void processed() override;
  void draw(cv::Mat& image) override;
  void draw_object(const Eigen::Matrix2Xd& points, Drawn drawn, cv::Mat& image) const;
  [[nodiscard]] nlohmann::json state() const override;
  [[nodiscard]] std::string status() const override;
  [[nodiscard]] std::vector<Action> own_actions() const override;
  bool act(const std::string& name) override;

  const face::appearance::Fitter& fitter_;
  face::appearance::FindStarts find_;
  face::appearance::TrackOptions options_;
  DebugSink* debug_;
  std::optional<face::appearance::Synthesis> synthesis_;  // where the model can be drawn
  face::appearance::Track track_;
  face::appearance::FitWorkspace workspace_;
  std::vector<face::appearance::TrackedObject> objects_;
  Drawn drawn_ = Drawn::kMesh;
  bool errors_ = false;
};

[[nodiscard]] std::string_view name_of(AppearanceSession::Drawn drawn);

}  // namespace tarsier
