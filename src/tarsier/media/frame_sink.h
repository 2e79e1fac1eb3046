// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/media/frame.h"
#include "tarsier/media/input_files.h"

#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

// Destination of output images. Not thread-safe: one producer.
class FrameSink {
 public:
  // An unfinished sink leaves no partial file, except for recordings (SinkOptions).
  virtual ~FrameSink() = default;

  // Writes `image` (CV_8UC3 or CV_8UC1), made from `source`. Returns the path written for this
  // frame, or an empty string if the frame has no file of its own. Throws OutputError.
  virtual std::string write(const cv::Mat& image, const Frame& source) = 0;

  // Completes the output (a video gets its final name). Throws OutputError. No write() may follow.
  virtual void finish() = 0;

  // One line for people: "http://127.0.0.1:8080/ (2 viewers)".
  [[nodiscard]] virtual std::string description() const = 0;
};

enum class SinkKind { kNone, kImage, kFolder, kVideo, kHttp };

struct SinkOptions {
  double fps = 25;        // of a video file
  int jpeg_quality = 90;  // of JPEG files and MJPEG streams
  // Extension of images in folders: ".png", ".jpg" ..; empty: that of the source, .png for video
  // frames.
  std::string folder_extension;
  // More than one image will follow: a path of a single image is then refused (UsageError).
  bool many = false;
  // MJPEG: listen on all interfaces, not only on loopback; needs a token.
  bool listen_all = false;
  // MJPEG: viewers must send it (?token=.. or Authorization: Bearer ..); 16 characters or more.
  std::string token;
  int max_viewers = 8;  // of MJPEG
  // The video cannot be recorded again (it comes from a camera). The data written before a crash or
  // a power cut can be played and is never removed (see part_file.h). The last second may be
  // missing.
  bool recording = false;
  // s. Length of the files that a video is cut into: v-0001.mp4, v-0002.mp4 .. Numbers continue
  // after existing files. 0: one file.
  double segment_s = 0;
  // Files that no image in a folder may replace.
  std::shared_ptr<const InputFiles> inputs;

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

//   none                       no output
//   file.png .jpg .webp .bmp   one image
//   file.mp4 .avi .mkv         a video
//   http://127.0.0.1:8080/     MJPEG over HTTP for browsers and other programs
//   anything else              a folder (created if missing); ends in '/' or has no extension
[[nodiscard]] SinkKind classify_sink(const std::string& text);

// Opens `text` for writing. Throws OutputError (not writable, port in use) and UsageError (unknown
// file extension, a non-loopback address without listen_all and token, a folder in which an image
// would replace one of options.inputs).
[[nodiscard]] std::unique_ptr<FrameSink> open_sink(const std::string& text,
                                                   const SinkOptions& options = {});

}  // namespace tarsier
