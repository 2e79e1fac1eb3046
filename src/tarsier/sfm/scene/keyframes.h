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
  // Of the image's diagonal: median motion of tracked corners since the last key frame.
  double min_motion = 0.03;
  int window = 8;       // frames; the sharpest of so many around is taken
  int max_count = 300;  // key frames

  [[nodiscard]] OptionFields fields() {
    return {{"min_motion", min_motion, range(0.001, 0.5), "--key-motion",
             "of the image's diagonal, between key frames"},
            {"window", window, range(1, 100)},
            {"max_count", max_count, at_least(1), "--max-frames", "key frames"}};
  }
  void check() const { check_fields(*this); }
};

struct Keyframe {
  cv::Mat image;  // a copy of the frame
  std::int64_t index = 0;
  double time = 0;       // s, as it was offered
  double motion = 0;     // of the diagonal, since the key frame before; 0: the first, or not known
  double sharpness = 0;  // variance of the Laplacian by the variance of the greys
};

// Chooses the frames of a video that are worth reconstructing from: moved far enough from the one
// before to show depth, near enough to overlap, and sharp.
//
// Up to 300 corners (Shi and Tomasi, CVPR 1994) of the last key frame are followed into each frame
// by pyramidal Lucas-Kanade and back, at 960 px at most; from the key frame itself, so that nothing
// drifts while the camera stands. When their median motion reaches `min_motion`, the next key
// frame is chosen among `window` frames around that moment that moved 0.5 to 2 times as far: the
// one of the greatest sharpness, less up to 10 % for its distance from the moment, so that key
// frames of an evenly moved camera are evenly spaced. When the corners are lost for half a window
// (a cut, a whip of the camera) one is chosen as well. An image without corners has no motion.
//
// Holds copies of up to `window` frames. Deterministic; one video per object.
class KeyframePicker {
 public:
  explicit KeyframePicker(const KeyframeOptions& options = {});

  // The next frame (8-bit BGR or grey, all of one size, indices rising) gives a key frame, often an
  // earlier one, or none. The first frame always is one; behind `most` come none. Throws
  // std::invalid_argument.
  [[nodiscard]] std::optional<Keyframe> offer(const cv::Mat& frame, std::int64_t index,
                                              double time);

  // At the end of the video, once: the sharpest of the last `window` frames, where they moved half
  // of `min_motion` at least or where the corners were lost.
  [[nodiscard]] std::optional<Keyframe> finish();

  [[nodiscard]] int count() const { return count_; }  // key frames so far
  // The corners of the last key frame, and where each was last seen: px of images of 960 px at most.
  [[nodiscard]] const std::vector<cv::Point2f>& corners() const { return corners_; }
  [[nodiscard]] const std::vector<cv::Point2f>& followed() const { return followed_; }

 private:
  struct Candidate {
    cv::Mat image;
    cv::Mat gray;  // reduced
    std::int64_t index = 0;
    double time = 0;
    double sharpness = 0;
    double motion = 0;  // of the diagonal
    bool is_lost = false;
  };

  void set_reference(const cv::Mat& gray);
  void measure(Candidate& candidate);
  void watch(const Candidate& candidate, std::size_t place);
  std::optional<Keyframe> choose(std::size_t begin, std::size_t end, std::size_t moment);
  [[nodiscard]] bool is_due() const;

  KeyframeOptions options_;
  cv::Size size_;
  std::int64_t last_index_ = 0;
  int count_ = 0;
  cv::Mat reference_;                  // reduced, where the corners were found
  std::vector<cv::Point2f> corners_;   // in the reference
  std::vector<cv::Point2f> followed_;  // where they were last seen
  std::deque<Candidate> waiting_;      // behind the last key frame, the newest last
  std::optional<std::size_t> moment_;  // in waiting_: where the motion was reached
  int lost_ = 0;                       // frames in a row
};

}  // namespace tarsier::sfm
