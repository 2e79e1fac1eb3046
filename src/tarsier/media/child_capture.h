// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/live_source.h"

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace tarsier {

// A program that captures, run as a child process that can be killed in any state. stdin is
// /dev/null, stdout carries the frames, stderr is kept for messages. The child inherits no other
// descriptor and no blocked signal, and has its own process group. It is never run through a shell.
struct ChildCommand {
  enum class Format {
    kRecords,  // CaptureRecord (capture_protocol.h)
    kMjpeg,    // consecutive JPEGs
  };
  std::vector<std::string> arguments;  // [0] is the path of the program
  // Variables set in the child, in addition to the inherited ones.
  std::vector<std::pair<std::string, std::string>> environment;
  Format format = Format::kRecords;
  std::string detail;       // one line, used until the child reports more
  bool is_network = false;  // a silent stream may recover without a new connection
  double startup_s = 0;     // time that the first frame may take, s
  // `check` runs before the start: why the source cannot work now, if known. `reachable`: whether
  // it would answer (see LiveBackend).
  std::function<std::optional<LiveFailure>()> check;
  std::function<bool(std::chrono::milliseconds, const std::stop_token&)> reachable;
};

[[nodiscard]] std::unique_ptr<LiveBackend> make_child_backend(ChildCommand command);

// The program that holds cameras: options.capture_program, else `tarsier-capture` beside this
// program, else in ../libexec/tarsier. Throws InputError if it is not found.
[[nodiscard]] std::string find_capture_program(const SourceOptions& options);

// A V4L2 camera by its device path ("/dev/video0", "/dev/v4l/by-id/.."); `label` names it in
// errors.
[[nodiscard]] ChildCommand camera_command(const std::string& path, const std::string& label,
                                          const SourceOptions& options);

// rtsp://, rtsps:// or https:// (and http://, for tests) through FFmpeg, with options.security.
// Throws InputError for an invalid URL.
[[nodiscard]] ChildCommand ffmpeg_command(const std::string& url, const SourceOptions& options);

// The Raspberry Pi's CSI camera number `index` through rpicam-vid or libcamera-vid. Throws
// InputError if neither is installed.
[[nodiscard]] ChildCommand pi_camera_command(int index, const SourceOptions& options);

}  // namespace tarsier
