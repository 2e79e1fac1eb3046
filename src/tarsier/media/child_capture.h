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

// A program that captures, run as a child that can be killed whatever it is stuck in: stdin is
// /dev/null, stdout the frames, stderr kept for messages; no other descriptor, no blocked signal, a
// process group of its own. Never through a shell.
struct ChildCommand {
  enum class Format {
    kRecords,  // CaptureRecord (capture_protocol.h)
    kMjpeg,    // JPEGs one after the other
  };
  std::vector<std::string> arguments;  // [0] is the path of the program
  // Set in the child, beside what is inherited.
  std::vector<std::pair<std::string, std::string>> environment;
  Format format = Format::kRecords;
  std::string detail;       // one line, until the child says more itself
  bool is_network = false;  // a silent stream may wake up by itself
  double startup_s = 0;     // how long it may take to the first frame, s
  // Before starting: why it cannot work now, if that is known; and whether it would (see
  // LiveBackend).
  std::function<std::optional<LiveFailure>()> check;
  std::function<bool(std::chrono::milliseconds, const std::stop_token&)> reachable;
};

[[nodiscard]] std::unique_ptr<LiveBackend> make_child_backend(ChildCommand command);

// The program that holds cameras: options.capture_program, else `tarsier-capture` beside this
// program, else in
// ../libexec/tarsier. Throws InputError if it is not there.
[[nodiscard]] std::string find_capture_program(const SourceOptions& options);

// A V4L2 camera by its device path ("/dev/video0", "/dev/v4l/by-id/.."); `label` names it in
// errors.
[[nodiscard]] ChildCommand camera_command(const std::string& path, const std::string& label,
                                          const SourceOptions& options);

// rtsp://, rtsps:// or https:// (and http://, for tests) through FFmpeg, as options.security says.
// Throws InputError for a bad URL.
[[nodiscard]] ChildCommand ffmpeg_command(const std::string& url, const SourceOptions& options);

// The Raspberry Pi's CSI camera number `index` through rpicam-vid or libcamera-vid. Throws
// InputError when neither is installed.
[[nodiscard]] ChildCommand pi_camera_command(int index, const SourceOptions& options);

}  // namespace tarsier
