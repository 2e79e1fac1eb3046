// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core/mat.hpp>

#include <memory>
#include <string>

namespace tarsier {

// Encodes frames to a video file with FFmpeg's libraries: MPEG-4 (part 2) in .mp4 and .mkv, JPEGs
// in .avi, at constant quality. The same frames give the same video bytes.
struct VideoEncoderOptions {
  std::string extension = ".mp4";  // ".mp4", ".avi" or ".mkv", whatever the extension of the path
  double fps = 25;
  // Every prefix of the file can be played, except for the last second: fragmented MP4, short
  // clusters, no buffering. For recordings that may be cut off at any time. Otherwise an MP4 has
  // one index, at its end, and cannot be played without it.
  bool crash_safe = false;

  [[nodiscard]] OptionFields fields() { return {{"fps", fps, above(0, 1000)}}; }
  void check() const;  // throws std::invalid_argument
};

class VideoEncoder {
 public:
  // Overwrites `path`. The sides of `size` must be even, px. Errors (OutputError) name
  // `display_path`. Throws std::invalid_argument for invalid options.
  VideoEncoder(const std::string& path, const std::string& display_path, cv::Size size,
               const VideoEncoderOptions& options);
  ~VideoEncoder();  // without finish() the file ends where it is
  VideoEncoder(const VideoEncoder&) = delete;
  VideoEncoder& operator=(const VideoEncoder&) = delete;

  void write(const cv::Mat& bgr);  // CV_8UC3 of that size
  void finish();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tarsier
