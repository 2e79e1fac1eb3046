// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core.hpp>

#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

namespace tarsier::sfm {

struct KeyframeOptions {
  // Median motion of the tracked corners since the last key frame, as a share of the image's
  // diagonal.
  double min_motion = 0.03;
  int window = 8;       // number of frames among which the sharpest is chosen
  int max_count = 300;  // max number of key frames

  [[nodiscard]] OptionFields fields() {
    return {{"min_motion", min_motion, range(0.001, 0.5), "--key-motion",
             "minimum motion between key frames, share of the image diagonal"},
            {"window", window, range(1, 100)},
            {"max_count", max_count, at_least(1), "--max-frames", "maximum number of key frames"}};
  }
  void check() const { check_fields(*this); }
};

struct Keyframe {
  cv::Mat image;  // a copy of the frame
  std::int64_t index = 0;
  double time = 0;  // s, as passed to offer()
  // share of the diagonal, since the previous key frame; 0: the first one, or unknown
  double motion = 0;
  double sharpness = 0;  // variance of the Laplacian / variance of the grey values
};

// Chooses the frames of a video that suit a reconstruction. They are sharp, far enough from the
// previous key frame to show depth, and near enough to overlap.
//
// Up to 300 corners (Shi and Tomasi, CVPR 1994) of the last key frame are tracked into each frame
// by pyramidal Lucas-Kanade, forward and backward, in images of at most 960 px. Tracking starts at
// the key frame itself, so nothing drifts while the camera stands still. When the median motion
// reaches `min_motion`, a key frame is chosen among the `window` frames around that time whose
// motion is 0.5 to 2 times as large. The sharpest one wins, after a penalty of up to 10 % for its
// distance from that time: an evenly moving camera then gives evenly spaced key frames. A key
// frame is also chosen when the corners are lost for half a window (a cut, a very fast camera). An
// image without corners has no motion.
//
// Holds copies of up to `window` frames. Deterministic. Use one object per video.
class KeyframePicker {
 public:
  explicit KeyframePicker(const KeyframeOptions& options = {});

  // Adds the next frame (8-bit BGR or grey, all of one size, increasing indices). Returns a key
  // frame, often an earlier one, or none. The first frame is always a key frame. After `max_count`
  // key frames there are no more. Throws std::invalid_argument.
  [[nodiscard]] std::optional<Keyframe> offer(const cv::Mat& frame, std::int64_t index,
                                              double time);

  // Call once at the end of the video. Returns the sharpest of the last `window` frames, where they
  // moved by at least half of `min_motion` or the corners were lost.
  [[nodiscard]] std::optional<Keyframe> finish();

  [[nodiscard]] int count() const { return count_; }  // key frames up to now
  // The corners of the last key frame, and where each was last tracked to: px of the reduced images
  // (at most 960 px).
  [[nodiscard]] const std::vector<cv::Point2f>& corners() const { return corners_; }
  [[nodiscard]] const std::vector<cv::Point2f>& tracked_corners() const { return tracked_corners_; }

 private:
  struct Candidate {
    cv::Mat image;
    cv::Mat gray;  // reduced
    std::int64_t index = 0;
    double time = 0;
    double sharpness = 0;
    double motion = 0;  // share of the diagonal
    bool is_lost = false;
  };

  void set_reference(const cv::Mat& gray);
  void measure(Candidate& candidate);
  void update_trigger(const Candidate& candidate, std::size_t index);
  std::optional<Keyframe> choose(std::size_t begin, std::size_t end, std::size_t trigger);
  [[nodiscard]] bool is_due() const;

  KeyframeOptions options_;
  cv::Size size_;
  std::int64_t last_index_ = 0;
  int count_ = 0;
  cv::Mat reference_;                         // reduced image in which the corners were found
  std::vector<cv::Point2f> corners_;          // in the reference
  std::vector<cv::Point2f> tracked_corners_;  // their last tracked positions
  std::deque<Candidate> buffer_;              // frames after the last key frame, the newest last
  std::optional<std::size_t> trigger_;        // index in buffer_ where the motion was reached
  int lost_ = 0;                              // consecutive frames in which the corners are lost
};

}  // namespace tarsier::sfm
