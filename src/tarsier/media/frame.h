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
  // 0, 1, 2 ... as the source counted them: a live source that drops frames skips numbers.
  std::int64_t index = 0;
  // Seconds since the source's first frame; video files: presentation time; stills: 0.
  double time = 0;
  std::string name;    // a still: its path exactly as given or found; else the source's text,
                       // passwords masked
  bool still = false;  // an image of its own (image, folder, glob, list), not a moment of a video
  std::string truth;   // JSON object with what is known exactly of a synthetic frame, else empty
  // When its last byte was in this machine (age = now - captured).
  std::chrono::steady_clock::time_point captured;
};

}  // namespace tarsier
