// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/media/frame.h"
#include "tarsier/media/stream_security.h"

#include <chrono>
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

// State of a source. Files change from kLive to kEnded; live sources move between the first four.
enum class SourceState { kConnecting, kLive, kStale, kLost, kEnded };
[[nodiscard]] std::string_view name_of(
    SourceState state);  // "connecting", "live", "stale", "lost", "ended"

struct SourceStatus {
  SourceState state = SourceState::kConnecting;
  // One line for people: what was opened ("1280x720 MJPG 30 fps"), or what is wrong.
  std::string detail;
  // Live sources: seconds since the newest frame that can be decoded arrived; 0 before the first.
  double age_s = 0;
  std::int64_t received = 0;  // frames that arrived
  // Received frames that a newer one replaced before anyone took them.
  std::int64_t dropped = 0;
  int reopened = 0;  // how often a live source was reopened
};

// Origin of frames. Not thread-safe: one consumer.
class FrameSource {
 public:
  virtual ~FrameSource() = default;

  // Returns the next frame; a live source gives the newest one and never the same twice. Waits at
  // most `timeout`. Returns nullopt if no frame came in time, `stop` was triggered, or there are
  // no more frames (see ended()). In a folder, glob or list of several images, an image that cannot
  // be read is skipped with a warning and listed in skipped(); a single image throws InputError.
  // Throws SourceLostError if a live source delivers no frame for SourceOptions::give_up_s after
  // its first.
  virtual std::optional<Frame> next(std::chrono::milliseconds timeout,
                                    const std::stop_token& stop) = 0;

  [[nodiscard]] virtual bool ended() const = 0;
  [[nodiscard]] virtual bool is_live() const = 0;
  [[nodiscard]] virtual SourceStatus status() const = 0;
  // The frame rate that the source states or was requested; 0 where there is none (stills).
  [[nodiscard]] virtual double fps() const = 0;
  // Number of frames if known in advance, else 0.
  [[nodiscard]] virtual std::int64_t count() const = 0;
  // Inputs that could not be read so far, each as "path: reason".
  [[nodiscard]] virtual const std::vector<std::string>& skipped() const = 0;
};

struct SourceOptions {
  // Size requested from cameras, px; 0: the camera's choice. The resulting size is logged.
  int width = 0;
  int height = 0;
  // Frame rate requested from cameras, and of folders with --sequence; 0: their default.
  double fps = 0;
  // Stills are a sequence in time (see Frame::still).
  bool sequence = false;
  // s. A live source without a first frame after this time throws InputError ...
  double connect_timeout_s = 10;
  // ... unless this is set: then the source is waited for without a limit.
  bool wait = false;
  // s. A live source without a frame for this time is stale and is reopened.
  double stall_s = 2.5;
  // s. A live source throws SourceLostError after this time without a frame; 0: never.
  double give_up_s = 60;
  // For https:// and rtsps://.
  StreamSecurity security;
  // The helper that holds cameras; empty: `tarsier-capture` beside this program.
  std::string capture_program;

  [[nodiscard]] OptionFields fields() {
    return {{"width", width, range(0, 32768), "--width",
             "requested camera image width, px; 0: the camera's choice"},
            {"height", height, range(0, 32768), "--height",
             "px, requested camera image height; 0: the camera's choice"},
            {"fps", fps, range(0, 1000), "--fps",
             "requested frame rate of a camera; frame rate of a --sequence; 0: the source's own"},
            {"sequence", sequence, "--sequence", "treat still images as the frames of a video"},
            {"wait", wait, "--wait", "wait without limit for a source that does not exist yet"},
            {"connect_timeout_s", connect_timeout_s, above(0, 3600), "--connect-timeout",
             "s until a live source must deliver its first frame"},
            {"stall_s", stall_s, above(0, 3600), "--stall",
             "s without a frame until a live source is reopened"},
            {"give_up_s", give_up_s, at_least(0), "--give-up",
             "s without a frame until the run ends; 0: never"}};
  }
  void check() const { check_fields(*this); }
};

// The kinds of source text (INPUT on the command line):
//   /path/image.jpg  /path/folder  '/path/*.jpg'  @list.txt  /path/video.avi
//       files
//   0  1 ..  /dev/video0  /dev/v4l/by-id/..
//       V4L2 cameras
//   picam:  picam:1
//       Raspberry Pi CSI cameras
//   http://host/..  https://host/..
//       MJPEG and JPEG are read by this program; other videos over https by FFmpeg in a child
//       process
//   rtsp://..  rtsps://..
//       through FFmpeg, in a child process
//   synth:NAME?key=value&..
//       opened by the caller's `schemes`, like viewer:NAME
// Certificates of https and rtsps are verified (SourceOptions::security), and redirects to other
// schemes are refused. Any other text is refused. User text never reaches a GStreamer pipeline or
// an unnamed backend.
enum class SourceKind {
  kImage,
  kFolder,
  kGlob,
  kList,
  kVideo,
  kCamera,
  kPiCamera,
  kHttp,  // and https
  kFfmpegUrl,
  kScheme
};

// Opens `text`, the part after the colon of "scheme:text", e.g. for "synth:".
using SchemeOpener =
    std::function<std::unique_ptr<FrameSource>(std::string_view text, const SourceOptions&)>;
struct Scheme {
  std::string name;  // without the colon
  SchemeOpener open;
};

// Decides by the form of the text, then by the file (folder, magic bytes). Throws InputError for
// text of no kind (missing file, unknown scheme, empty); the message says what was expected.
[[nodiscard]] SourceKind classify_source(const std::string& text,
                                         const std::vector<Scheme>& schemes = {});

// Opens one input. Files are checked before this returns. It does not wait for live sources; next()
// does. Throws InputError (missing, empty folder, not an image or video, no such camera).
[[nodiscard]] std::unique_ptr<FrameSource> open_source(const std::string& text,
                                                       const SourceOptions& options = {},
                                                       const std::vector<Scheme>& schemes = {});

// Opens several inputs as one sequence with consecutive numbers. A single input is opened directly.
[[nodiscard]] std::unique_ptr<FrameSource> open_sources(const std::vector<std::string>& texts,
                                                        const SourceOptions& options = {},
                                                        const std::vector<Scheme>& schemes = {});

// Returns `url` with user name and password replaced by "***".
[[nodiscard]] std::string masked(std::string_view url);

}  // namespace tarsier
