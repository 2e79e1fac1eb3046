// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/mat.hpp>

#include <chrono>
#include <cstdint>
#include <string>

namespace tarsier {

// One image of a source.
struct Frame {
  cv::Mat image;  // CV_8UC3, BGR
  // 0, 1, 2 ... as the source counts; a live source that drops frames skips numbers.
  std::int64_t index = 0;
  // Seconds since the source's first frame; the presentation time in a video file; 0 for stills.
  double time = 0;
  // Where several inputs are read in turn: `index` and `time` that the first frame of its own input
  // has; else 0. (Both above count on from input to input.)
  std::int64_t start_index = 0;
  double start_time = 0;
  // For a still: its path exactly as given or found. Else the source's text with passwords masked.
  std::string name;
  // An image of its own (image, folder, glob, list), not a frame of a video.
  bool still = false;
  // JSON object with the ground truth of a synthetic frame, else empty.
  std::string truth;
  // When the last byte of the frame arrived in this machine (age = now - captured).
  std::chrono::steady_clock::time_point captured;
};

}  // namespace tarsier
