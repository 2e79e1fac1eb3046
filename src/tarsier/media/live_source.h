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

// Why a live source could not be opened, or why it ended.
struct LiveFailure {
  std::string reason;  // one line
  // Before the first frame: not worth waiting for (no such device, refused, 404).
  bool definite = false;
  bool unreachable = false;  // nothing answers at all: worth a probe each second
  bool denied = false;       // it answers and says no: not asked more often than the back-off says
};

// An image as it came in: a JPEG not decoded yet, or (encoded is empty) a decoded one, CV_8UC3.
struct LiveImage {
  std::vector<std::uint8_t> encoded;
  cv::Mat image;
  std::chrono::steady_clock::time_point arrived;  // when its last byte did
};

struct LiveRead {
  enum class Kind { kNothing, kFrame, kEnded };
  Kind kind = Kind::kNothing;
  LiveImage image;          // kFrame: the newest of those that arrived
  std::int64_t frames = 0;  // kFrame: how many arrived, >= 1
  LiveFailure failure;      // kEnded
};

// One connection to one camera: opened once, read until it ends, destroyed (which closes it within
// 0.2 s). All calls come from the supervising thread, and each returns within 0.1 s of its stop
// token firing.
class LiveBackend {
 public:
  virtual ~LiveBackend() = default;

  // Begins; the answer of the other side is waited for in read(). Takes at most `patience`.
  virtual std::optional<LiveFailure> open(std::chrono::milliseconds patience,
                                          const std::stop_token& stop) = 0;
  // Waits at most `patience` for a frame; takes in everything that is there and returns the newest.
  virtual LiveRead read(std::chrono::milliseconds patience, const std::stop_token& stop) = 0;
  // Before open(): whether something would answer now. Cheap; takes at most `patience`.
  virtual bool reachable(std::chrono::milliseconds patience, const std::stop_token& stop) = 0;

  [[nodiscard]] virtual std::string detail() const = 0;  // what was opened, one line
  [[nodiscard]] virtual double fps() const = 0;          // 0: not known
  // A silent connection may wake up by itself (network), so it is listened to for longer before it
  // is opened again; a silent device does not and is closed at once.
  [[nodiscard]] virtual bool may_wake_up() const = 0;
  // Seconds it may take to its first frame if that is longer than SourceOptions::stall_s, else 0.
  [[nodiscard]] virtual double startup_s() const = 0;
  // There is nothing to open again: a silent one is listened to for as long as it is there, and its
  // end is the end of the source.
  [[nodiscard]] virtual bool opens_once() const { return false; }
};
using LiveBackendFactory = std::function<std::unique_ptr<LiveBackend>()>;

// Times that a user does not set. Seconds, > 0.
struct LiveTiming {
  double backoff_s = 1;       // the first wait before opening again; doubles ..
  double backoff_max_s = 30;  // .. up to this
  double answering_max_s =
      2.5;                    // limit of the wait for something that answers, but not with frames
  double probe_s = 1;         // how often something that did not answer is tried while waiting
  double healthy_s = 10;      // of frames, after which the back-off starts again
  double open_attempt_s = 3;  // the longest one open() may take
};

// A live source over `make_backend`: one thread supervises it, keeps only the newest frame, watches
// for stalls and opens it again. JPEGs are decoded by next(), so that only frames that someone sees
// cost that time.
//   connecting  being opened, no frame from this connection yet
//   live        frames come
//   stale       open, but no frame for SourceOptions::stall_s
//   lost        closed; opened again after the back-off, or as soon as it answers
// `name` goes into Frame::name, `label` into messages and errors (passwords masked in both).
[[nodiscard]] std::unique_ptr<FrameSource> make_live_source(std::string name, std::string label,
                                                            LiveBackendFactory make_backend,
                                                            const SourceOptions& options,
                                                            const LiveTiming& timing = {});

}  // namespace tarsier
