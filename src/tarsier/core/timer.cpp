// SPDX-License-Identifier: MIT
#include "tarsier/core/timer.h"

#include <fmt/format.h>

#include <algorithm>

namespace tarsier {

void Timers::add(std::string_view name, double ms) {
  const std::lock_guard lock(mutex_);
  auto found = std::find_if(stats_.begin(), stats_.end(),
                            [&](const TimerStats& s) { return s.name == name; });
  if (found == stats_.end()) {
    stats_.push_back({std::string(name), 0, 0, ms, ms, 0});
    found = stats_.end() - 1;
  }
  found->runs += 1;
  found->last_ms = ms;
  found->min_ms = std::min(found->min_ms, ms);
  found->max_ms = std::max(found->max_ms, ms);
  found->total_ms += ms;
}

std::vector<TimerStats> Timers::stats() const {
  const std::lock_guard lock(mutex_);
  return stats_;
}

std::string Timers::report() const {
  std::string table = fmt::format("{:<20} {:>8} {:>10} {:>10} {:>10} {:>10}\n", "stage", "runs",
                                  "last ms", "average", "min", "max");
  for (const TimerStats& s : stats()) {
    table += fmt::format("{:<20} {:>8} {:>10.3f} {:>10.3f} {:>10.3f} {:>10.3f}\n", s.name, s.runs,
                         s.last_ms, s.average_ms(), s.min_ms, s.max_ms);
  }
  return table;
}

}  // namespace tarsier
