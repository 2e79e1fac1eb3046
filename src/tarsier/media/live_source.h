// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame_source.h"

#include <opencv2/core/mat.hpp>

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier {

// Minimum time between two warnings of corrupt images.
inline constexpr std::chrono::seconds kWarningInterval{1};

// Why a live source could not be opened, or why it ended.
struct LiveFailure {
  std::string reason;  // one line
  // Before the first frame: waiting does not help (no such device, refused, 404).
  bool permanent = false;
  bool unreachable = false;  // nothing answers: probe once a second
  bool denied = false;       // it answers with a refusal: retry only at the back-off's pace
};

// An image as received: either a JPEG that is not decoded yet, or (`encoded` is empty) a decoded
// one, CV_8UC3.
struct LiveImage {
  std::vector<std::uint8_t> encoded;
  cv::Mat image;
  std::chrono::steady_clock::time_point arrived;  // when its last byte arrived
};

struct LiveRead {
  enum class Kind { kNothing, kFrame, kEnded };
  Kind kind = Kind::kNothing;
  LiveImage image;          // kFrame: the newest of the frames that arrived
  std::int64_t frames = 0;  // kFrame: how many arrived, >= 1
  LiveFailure failure;      // kEnded
};

// One connection to one camera: opened once, read until it ends, then destroyed (which closes it
// within 0.2 s). All calls come from the supervising thread. Each returns within 0.1 s after its
// stop token is triggered.
class LiveBackend {
 public:
  virtual ~LiveBackend() = default;

  // Starts to open; read() waits for the answer of the other side. Takes at most `timeout`.
  virtual std::optional<LiveFailure> open(std::chrono::milliseconds timeout,
                                          const std::stop_token& stop) = 0;
  // Waits at most `timeout` for a frame. Reads everything that arrived and returns the newest
  // frame.
  virtual LiveRead read(std::chrono::milliseconds timeout, const std::stop_token& stop) = 0;
  // Before open(): whether something would answer now. Cheap; takes at most `timeout`.
  virtual bool reachable(std::chrono::milliseconds timeout, const std::stop_token& stop) = 0;

  [[nodiscard]] virtual std::string detail() const = 0;  // what was opened, one line
  [[nodiscard]] virtual double fps() const = 0;          // 0: unknown
  // Whether a silent connection may recover by itself. A network connection may, so the source
  // waits longer before it reopens it. A device does not, and is closed at once.
  [[nodiscard]] virtual bool may_recover() const = 0;
  // Seconds until the first frame if that is longer than SourceOptions::stall_s, else 0.
  [[nodiscard]] virtual double startup_s() const = 0;
  // Whether the connection cannot be reopened. A silent one is then kept as long as it exists, and
  // its end is the end of the source.
  [[nodiscard]] virtual bool opens_once() const { return false; }
};
using LiveBackendFactory = std::function<std::unique_ptr<LiveBackend>()>;

// Times that users do not set. Seconds, > 0.
struct LiveTiming {
  double backoff_s = 1;       // the first wait before a reopen; doubles ..
  double backoff_max_s = 30;  // .. up to this
  // Limit of the wait for something that answers, but not with frames.
  double max_wait_when_answering_s = 2.5;
  double probe_s = 1;         // interval of probes of something that does not answer
  double healthy_s = 10;      // time with frames after which the back-off is reset
  double open_attempt_s = 3;  // limit for one open()
};

// A live source over `make_backend`. One thread supervises it, keeps only the newest frame, detects
// stalls and reopens it. next() decodes the JPEGs, so that only frames that are used cost decoding
// time.
//   connecting  being opened, no frame from this connection yet
//   live        frames arrive
//   stale       open, but no frame for SourceOptions::stall_s
//   lost        closed; reopened after the back-off, or as soon as it answers
// `name` is used in Frame::name, `label` in messages and errors (passwords masked in both).
[[nodiscard]] std::unique_ptr<FrameSource> make_live_source(std::string name, std::string label,
                                                            LiveBackendFactory make_backend,
                                                            const SourceOptions& options,
                                                            const LiveTiming& timing = {});

}  // namespace tarsier
