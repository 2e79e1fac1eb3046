// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/sfm/pipelines/online_reconstructor.h"

#include <opencv2/core.hpp>

#include "ui/frame_session.h"
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier {

// Shows a reconstruction that grows with its video. At the left: the frame, with the points of the
// model that are seen in it. At the right: the point cloud and its cameras. While the model grows,
// the host waits.
// Keys: space pauses, arrows or dragging with the mouse rotate the cloud, + - and the wheel zoom, 0
// resets the view, r runs bundle adjustment over the whole model, h help, q or Esc quits.
// State: {"key_frames", "registered", "points", "followed": points of the model in the frame,
// "no_model": why there is no model yet, where a reason is known, "paused"}.
class SfmSession final : public FrameSession {
 public:
  // `online` must outlive the session. If `stop` is triggered, growing ends early. on_frame()
  // throws what OnlineReconstructor::process() throws. `debug` may be null and must outlive the
  // session. It receives the stages of each frame.
  explicit SfmSession(sfm::OnlineReconstructor& online, std::stop_token stop = {},
                      DebugSink* debug = nullptr);

  // No more frames: adds the video's last key frame and the pending images.
  View finish();

 private:
  void process(const Frame& frame) override;
  void draw(cv::Mat& image) override;
  bool act(const std::string& name) override;
  bool mouse(const Event& event) override;
  [[nodiscard]] nlohmann::json state() const override;
  [[nodiscard]] std::string status() const override;
  [[nodiscard]] std::vector<Action> own_actions() const override;
  [[nodiscard]] std::vector<image::draw::HelpLine> help_lines() const override;

  void rotate(double yaw, double pitch);
  void zoom(double factor);
  void update(sfm::OnlineResult result);
  [[nodiscard]] std::string counts() const;
  [[nodiscard]] std::string why_no_model() const;

  sfm::OnlineReconstructor& online_;
  std::stop_token stop_;
  DebugSink* debug_;
  sfm::OnlineResult result_;  // of the latest call
  cv::Mat image_;             // the latest frame, as used by the model
  cv::Mat cloud_;
  bool cloud_is_stale_ = true;
  double yaw_ = 0;
  double pitch_ = 15;
  double zoom_ = 1;
  std::optional<cv::Point2d> drag_;  // last position of the mouse
};

}  // namespace tarsier
