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

// The clocks of the machine; tests give others.
struct Clocks {
  std::function<Moment()> wall;                       // people and NTP set it
  std::function<std::chrono::milliseconds()> uptime;  // nobody sets it; goes on in sleep
  std::function<std::chrono::steady_clock::time_point()> steady;  // that of Frame::captured
  // Whether the system says that the wall clock is synchronized (by NTP, say); false where it says
  // nothing.
  std::function<bool()> synchronized;
};
[[nodiscard]] Clocks system_clocks();

// No moment before 2024-01-01 is taken for the present: a machine without a clock of its own begins
// in 1970, or when its system was built.
[[nodiscard]] bool is_plausible(Moment now);

// How a source's frames lie in time.
struct SourceTimes {
  // A camera or stream: a frame is of the moment when it arrived. Else a recording.
  bool live = true;
  // Of a recording: the moment of its first frame. Nothing: each frame is of the moment when it was
  // read, while durations are those of the recording.
  std::optional<Moment> start;
};

// Of a video file that was last written at `modified`, `length` long: it began so much earlier. Not
// in the future of `now`, whatever the file says.
[[nodiscard]] Moment recording_start(Moment modified, std::chrono::milliseconds length, Moment now);

// Gives each frame its moment, and notices when the wall clock is set.
//
//   SourceClock clock(system_clocks());
//   clock.begin({.live = true}, 0);                        // for each source
//   const FrameMoment seen = clock.at(frame.time, frame.captured);
//   if (const auto step = clock.take_step()) ..            // the wall clock was set by so much
class SourceClock {
 public:
  explicit SourceClock(Clocks clocks);

  // A new source; `first_time` is that of its first frame, s.
  void begin(const SourceTimes& times, double first_time);

  // `time`: the frame's, s. `captured`: when it arrived; of what is older than an hour or comes
  // from the future, now.
  [[nodiscard]] FrameMoment at(double time, std::chrono::steady_clock::time_point captured);

  // By how much the wall clock was set since the last call, by all calls of at() in between.
  // Differences of less than 2 s, and 100 ppm of the time between, are drift.
  [[nodiscard]] std::optional<std::chrono::milliseconds> take_step();

 private:
  void watch(Moment wall, std::chrono::milliseconds uptime);

  Clocks clocks_;
  SourceTimes times_;
  double first_time_ = 0;
  std::optional<Moment> last_wall_;
  std::chrono::milliseconds last_uptime_{0};
  std::chrono::milliseconds step_{0};
};

}  // namespace tarsier::plate
