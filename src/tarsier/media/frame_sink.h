// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/media/frame.h"

#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

// Where finished images go. Not thread-safe: one producer.
class FrameSink {
 public:
  // An unfinished sink leaves no half-written file behind, but for recordings (SinkOptions).
  virtual ~FrameSink() = default;

  // Takes `image` (CV_8UC3 or CV_8UC1), made from `source`. Returns what was written for this frame
  // (a path), or an empty string where a frame has no file of its own. Throws OutputError.
  virtual std::string write(const cv::Mat& image, const Frame& source) = 0;

  // Completes the output (a video gets its name here). Throws OutputError. write() may not follow.
  virtual void finish() = 0;

  // One line for people: "http://127.0.0.1:8080/ (2 viewers)".
  [[nodiscard]] virtual std::string description() const = 0;
};

enum class SinkKind { kNone, kImage, kFolder, kVideo, kHttp };

struct SinkOptions {
  double fps = 25;               // of a video file
  int jpeg_quality = 90;         // of JPEG files and MJPEG streams
  std::string folder_extension;  // images in folders: ".png", ".jpg" ..; empty: that of the
                                 // source, .png for video frames
  // More than one image is to come: an image path is then refused (UsageError).
  bool many = false;
  bool listen_all = false;  // MJPEG: listen on every interface, not on loopback only; needs a token
  std::string token;        // MJPEG: viewers must give it (?token=.. or Authorization: Bearer ..);
                            // 16 characters or more
  int max_viewers = 8;      // of MJPEG
  // A video that cannot be made a second time (of a camera): what was written until a crash or a
  // power cut plays, and is never removed (see part_file.h). A second of video may be missing.
  bool recording = false;
  double segment_s = 0;  // a video is cut into files of so many seconds: v-0001.mp4,
                         // v-0002.mp4 ..; numbers go on after those that are there; 0: one file

  [[nodiscard]] OptionFields fields() {
    return {{"fps", fps, above(0, 1000)},
            {"jpeg_quality", jpeg_quality, range(1, 100), "--jpeg-quality",
             "quality of JPEG files and streams"},
            {"listen_all", listen_all, "--listen-all",
             "http output: accept connections from other machines; needs a token"},
            {"token", token, "--token",
             "http output: token that viewers must send, 16 characters or more"},
            {"max_viewers", max_viewers, range(1, 64)},
            {"segment_s", segment_s, at_least(0)}};
  }
  void check() const;
};

//   none                       nothing
//   file.png .jpg .webp .bmp   one image
//   file.mp4 .avi .mkv         a video
//   http://127.0.0.1:8080/     MJPEG over HTTP for browsers and other programs
//   anything else              a folder (made if missing); ending in '/' or without an extension
[[nodiscard]] SinkKind classify_sink(const std::string& text);

// Opens `text` for writing. Throws OutputError (unwritable, port taken), UsageError (an unknown
// file ending, a non-loopback address without listen_all and token).
[[nodiscard]] std::unique_ptr<FrameSink> open_sink(const std::string& text,
                                                   const SinkOptions& options = {});

}  // namespace tarsier
