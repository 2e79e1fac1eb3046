// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/head/liveness.h"
#include "tarsier/face/pipelines/pose_tracker.h"

#include "ui/frame_session.h"
#include <cstdint>
#include <string>

namespace tarsier {

// Asks the largest face of a video to blink and to turn (face/head/liveness.h), and reports whether
// it did. After the first request it watches only that face.
// Keys: n restarts with another order, space pauses, h help, q or Esc quits.
// State: {"state", "task" (or null), "done", "tasks", "reason" (or null), "paused"}.
class LivenessSession final : public FrameSession {
 public:
  // `tracker` has 68 points. Throws std::invalid_argument for invalid options or other points.
  LivenessSession(face::PoseTracker tracker, std::uint64_t seed,
                  const face::head::LivenessOptions& options);

  [[nodiscard]] const face::head::LivenessStatus& challenge() const { return liveness_.status(); }
  // {"state", "task", "done", "tasks", "left_s", "openness", "parallax", "reason"}
  [[nodiscard]] nlohmann::ordered_json challenge_json() const;

 private:
  void process(const Frame& frame) override;
  void restart() override;
  void draw(cv::Mat& image) override;
  [[nodiscard]] nlohmann::json state() const override;
  [[nodiscard]] std::string status() const override;
  [[nodiscard]] std::vector<Action> own_actions() const override;
  bool act(const std::string& name) override;

  face::PoseTracker tracker_;
  face::PoseState state_;
  face::PoseResult result_;
  std::uint64_t seed_;
  face::head::LivenessOptions options_;
  face::head::Liveness liveness_;
  int challenged_id_ = 0;  // id of the face that was asked; 0: none yet
};

}  // namespace tarsier
