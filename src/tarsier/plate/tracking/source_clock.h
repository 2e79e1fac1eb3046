// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/tracking/event.h"
#include "tarsier/plate/tracking/time_text.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

// The wall clock of each frame.
namespace tarsier::plate {

// The clocks of the machine. Tests use others.
struct Clocks {
  std::function<Moment()> wall;                       // set by users and NTP
  std::function<std::chrono::milliseconds()> uptime;  // monotonic; continues during sleep
  std::function<std::chrono::steady_clock::time_point()> steady;  // the clock of Frame::captured
  // Whether the system reports that the wall clock is synchronized (for example by NTP). False if
  // the system reports nothing.
  std::function<bool()> synchronized;
};
[[nodiscard]] Clocks system_clocks();

// Returns whether `now` is 2024-01-01 or later. A machine without a battery-backed clock starts in
// 1970, or at the time when its system was built.
[[nodiscard]] bool is_plausible(Moment now);

// How the times of a source's frames map to the wall clock.
struct SourceTimes {
  // A camera or stream: the time of a frame is its arrival. Otherwise the source is a recording.
  bool live = true;
  // For a recording: the time of its first frame. If empty, the time of a frame is the time when it
  // is read, while durations are those of the recording.
  std::optional<Moment> start;
};

// Start of a video file that was last written at `modified` and is `length` long. Never later than
// `now`.
[[nodiscard]] Moment recording_start(Moment modified, std::chrono::milliseconds length, Moment now);

// Gives each frame its wall-clock time, and detects steps of the wall clock.
//
//   SourceClock clock(system_clocks());
//   clock.begin({.live = true}, 0);                        // for each source
//   const FrameMoment moment = clock.at(frame.time, frame.captured);
//   if (const auto step = clock.take_step()) ..            // the wall clock was set by so much
class SourceClock {
 public:
  explicit SourceClock(Clocks clocks);

  // Starts a new source; `first_time` is the time of its first frame, s.
  void begin(const SourceTimes& times, double first_time);

  // `time` is the frame's time, s. `captured` is its arrival; if this is more than an hour ago or
  // in the future, the present time is used.
  [[nodiscard]] FrameMoment at(double time, std::chrono::steady_clock::time_point captured);

  // The sum of the wall clock's steps since the last call, as observed by at(). Differences below 2
  // s plus 100 ppm of the elapsed time count as drift.
  [[nodiscard]] std::optional<std::chrono::milliseconds> take_step();

 private:
  void detect_step(Moment wall, std::chrono::milliseconds uptime);

  Clocks clocks_;
  SourceTimes times_;
  double first_time_ = 0;
  std::optional<Moment> last_wall_;
  std::chrono::milliseconds last_uptime_{0};
  std::chrono::milliseconds step_{0};
};

}  // namespace tarsier::plate
