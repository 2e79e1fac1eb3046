// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/face/appearance/synthesis.h"
#include "tarsier/face/pipelines/appearance_tracker.h"

#include "ui/frame_session.h"
#include <optional>
#include <string>
#include <vector>

namespace tarsier {

// Shows the fits of a face::AppearanceTracker. Objects of a still are detected again; those of a
// video or camera are tracked. Keys: v what is drawn (mesh, the model's face over the image,
// points, nothing), e the error image, d re-detects, space pauses, h help, q or Esc quits. State:
// {"faces": number, "ids": [..], "error", "drawn", "paused"}.
class AppearanceSession final : public FrameSession {
 public:
  enum class Overlay { kMesh, kFace, kPoints, kNothing };

  // `debug` may be null and must outlive the session. It receives the meshes, the model's faces
  // over the image, and for each object its texture, the model's texture and their difference.
  // `state` may have other start methods than the tracker's.
  AppearanceSession(face::AppearanceTracker tracker, Overlay overlay, DebugSink* debug = nullptr,
                    face::AppearanceState state = {});

  // The objects of the latest frame.
  [[nodiscard]] const std::vector<face::appearance::TrackedObject>& objects() const {
    return objects_;
  }
  [[nodiscard]] bool is_tracking() const { return !still(); }

 private:
  void process(const Frame& frame) override;
  void on_processed() override;
  void draw(cv::Mat& image) override;
  void draw_object(const Eigen::Matrix2Xd& points, Overlay overlay, cv::Mat& image) const;
  [[nodiscard]] nlohmann::json state() const override;
  [[nodiscard]] std::string status() const override;
  [[nodiscard]] std::vector<Action> own_actions() const override;
  bool act(const std::string& name) override;

  face::AppearanceTracker tracker_;
  DebugSink* debug_;
  std::optional<face::appearance::Synthesis> synthesis_;  // if the model can be drawn
  face::AppearanceState state_;
  std::vector<face::appearance::TrackedObject> objects_;
  Overlay overlay_ = Overlay::kMesh;
  bool shows_error_ = false;
};

[[nodiscard]] std::string_view name_of(AppearanceSession::Overlay overlay);

}  // namespace tarsier
