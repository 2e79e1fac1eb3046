// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/source_clock.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <sys/timex.h>
#include <unistd.h>
#include <utility>

namespace tarsier::plate {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kMaxDrift{2000};
constexpr std::int64_t kDriftDivisor = 10'000;  // 100 ppm
constexpr milliseconds kMaxAge = std::chrono::hours(1);

// Uptime of the system, including sleep.
milliseconds uptime_now() {
  timespec now{};
  if (::clock_gettime(CLOCK_BOOTTIME, &now) != 0) {
    return std::chrono::duration_cast<milliseconds>(
        std::chrono::steady_clock::now().time_since_epoch());
  }
  return std::chrono::duration_cast<milliseconds>(std::chrono::seconds(now.tv_sec) +
                                                  std::chrono::nanoseconds(now.tv_nsec));
}

// Asks the kernel. A confined service may not do so, but it sees the file that systemd-timesyncd
// creates.
bool is_synchronized() {
  timex state{};
  const int answer = ::adjtimex(&state);
  if (answer >= 0) return answer != TIME_ERROR && (state.status & STA_UNSYNC) == 0;
  return ::access("/run/systemd/timesync/synchronized", F_OK) == 0;
}

milliseconds milliseconds_of(double seconds) {
  TARSIER_REQUIRE(std::isfinite(seconds) && std::abs(seconds) < 1e10, "time {} s", seconds);
  return milliseconds(std::llround(1000 * seconds));
}

}  // namespace

Clocks system_clocks() {
  return {moment_now, uptime_now, [] { return std::chrono::steady_clock::now(); }, is_synchronized};
}

bool is_plausible(Moment now) {
  return now >= Moment(std::chrono::sys_days(std::chrono::year(2024) / 1 / 1));
}

Moment recording_start(Moment modified, milliseconds length, Moment now) {
  return std::min(modified, now) - std::max(length, milliseconds(0));
}

SourceClock::SourceClock(Clocks clocks) : clocks_(std::move(clocks)) {
  TARSIER_REQUIRE(clocks_.wall && clocks_.uptime && clocks_.steady && clocks_.synchronized,
                  "a clock is missing");
}

void SourceClock::begin(const SourceTimes& times, double first_time) {
  times_ = times;
  first_time_ = first_time;
}

FrameMoment SourceClock::at(double time, std::chrono::steady_clock::time_point captured) {
  const Moment wall = clocks_.wall();
  const milliseconds uptime = clocks_.uptime();
  detect_step(wall, uptime);
  FrameMoment moment;
  if (!times_.live && times_.start) {
    moment.uptime = milliseconds_of(time - first_time_);
    moment.wall = *times_.start + moment.uptime;
    return moment;
  }
  const auto age = std::chrono::duration_cast<milliseconds>(clocks_.steady() - captured);
  const milliseconds ago = age < milliseconds(0) || age > kMaxAge ? milliseconds(0) : age;
  moment.wall = wall - ago;
  moment.uptime = times_.live ? uptime - ago : milliseconds_of(time - first_time_);
  moment.synchronized = is_plausible(wall) && clocks_.synchronized();
  return moment;
}

void SourceClock::detect_step(Moment wall, milliseconds uptime) {
  if (last_wall_) {
    const milliseconds elapsed = uptime - last_uptime_;
    const milliseconds offset = (wall - *last_wall_) - elapsed;
    if (std::chrono::abs(offset) > kMaxDrift + std::chrono::abs(elapsed) / kDriftDivisor)
      step_ += offset;
  }
  last_wall_ = wall;
  last_uptime_ = uptime;
}

std::optional<milliseconds> SourceClock::take_step() {
  if (step_ == milliseconds(0)) return std::nullopt;
  return std::exchange(step_, milliseconds(0));
}

}  // namespace tarsier::plate
