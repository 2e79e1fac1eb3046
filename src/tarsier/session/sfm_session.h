// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/session/session.h"
#include "tarsier/sfm/mapper/online.h"
#include "tarsier/sfm/scene/keyframes.h"
#include "tarsier/sfm/view/render.h"

#include <deque>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

namespace tarsier {

struct SfmSessionOptions {
  sfm::KeyframeOptions keyframes;
  bool every_frame = false;  // images: each is a key frame
  int every = 3;             // key frames from one growth of the model to the next; 1..1000
  void check() const;
};

// A model that grows while its video is shown: at the left the frame, with the points of the model
// that are seen in it; at the right the cloud and its cameras. Each key frame is kept as a file and
// added to the mapper; after every few the model grows, while the host waits.
// Keys: space pauses, arrows or a dragged mouse turn the cloud, + - and the wheel zoom, 0 is the
// first view again, r adjusts all of the model, h help, q or Esc ends.
// State: {"key_frames", "registered", "points", "followed": points of the model in the frame,
// "paused"}.
class SfmSession final : public Session {
 public:
  // Writes a key frame, or finds the file that it is, and names it. `latest` is the frame that was
  // on when it was chosen, often a later one.
  using Keep = std::function<sfm::Input(const sfm::Keyframe& key_frame, const Frame& latest)>;

  // `mapper` must outlive the session. When `stop` fires, growing ends early. Throws
  // std::invalid_argument for bad options. on_frame throws what `keep` and the cache throw.
  SfmSession(sfm::OnlineMapper& mapper, Keep keep, const SfmSessionOptions& options,
             const std::stop_token& stop = {});

  View on_frame(const Frame& frame, const SourceStatus& source) override;
  View on_idle(const SourceStatus& source) override;
  View on_event(const Event& event) override;
  [[nodiscard]] std::vector<Action> actions() const override;
  [[nodiscard]] std::vector<Slider> sliders() const override { return {}; }

  // No more frames: the video's last key frame; the model grows by what is waiting.
  View finish();

  // The key frames so far, in order.
  [[nodiscard]] const std::vector<sfm::Input>& inputs() const { return inputs_; }

 private:
  // What was seen of the model in one of its images, and where it is now.
  struct Followed {
    cv::Mat gray;  // reduced
    std::vector<cv::Point2f> from;
    std::vector<cv::Point2f> to;
    std::vector<char> is_lost;
  };

  void take(const sfm::Keyframe& key_frame, const Frame& latest);
  void grow(bool again);
  void choose_points();
  void follow();
  void turn(double yaw, double pitch);
  void zoom(double factor);
  void draw();
  View view(bool fresh);
  [[nodiscard]] std::string counts() const;

  sfm::OnlineMapper& mapper_;
  Keep keep_;
  SfmSessionOptions options_;
  std::stop_token stop_;
  sfm::KeyframePicker picker_;
  std::vector<sfm::Input> inputs_;
  int waiting_ = 0;                             // key frames since the last growth
  std::deque<std::pair<int, cv::Mat>> recent_;  // image of the mapper, reduced grey picture
  Followed followed_;
  Frame latest_;
  cv::Mat gray_;  // of latest_, reduced
  cv::Mat cloud_;
  bool cloud_is_old_ = true;
  double yaw_ = 0;
  double pitch_ = 15;
  double zoom_ = 1;
  std::optional<cv::Point2d> drag_;  // where the mouse was
  cv::Mat output_;
  cv::Mat shown_;
  std::string source_;
  bool paused_ = false;
  bool help_ = false;
  bool finished_ = false;
};

}  // namespace tarsier
