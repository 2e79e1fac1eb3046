// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <opencv2/core/mat.hpp>

#include <memory>
#include <string>

namespace tarsier {

// Frames into a video file, by FFmpeg's libraries: MPEG-4 (part 2) in .mp4 and .mkv, JPEGs in .avi,
// at constant quality. The same frames give the same bytes of video.
struct VideoEncoderOptions {
  std::string ending = ".mp4";  // ".mp4", ".avi" or ".mkv", whatever the path ends in
  double fps = 25;
  // Every beginning of the file plays (a fragmented MP4, short clusters, nothing held back), but
  // for the last second: for recordings that may be cut off at any time. Else an MP4 has one index,
  // at its end, and nothing plays without it.
  bool cut_safe = false;

  [[nodiscard]] OptionFields fields() { return {{"fps", fps, above(0, 1000)}}; }
  void check() const;  // throws std::invalid_argument
};

class VideoEncoder {
 public:
  // Replaces what is in `path`. Sides of `size` are even, px. Errors (OutputError) name `shown`.
  // Throws std::invalid_argument for bad options.
  VideoEncoder(const std::string& path, const std::string& shown, cv::Size size,
               const VideoEncoderOptions& options);
  ~VideoEncoder();  // without finish(): the file ends where it is
  VideoEncoder(const VideoEncoder&) = delete;
  VideoEncoder& operator=(const VideoEncoder&) = delete;

  void write(const cv::Mat& bgr);  // CV_8UC3 of that size
  void finish();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace tarsier
