// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <string>
#include <string_view>

// Parses and formats moments and durations. Moments are UTC, with millisecond resolution.
namespace tarsier::plate {

using Moment = std::chrono::sys_time<std::chrono::milliseconds>;

// "2024-05-01T12:30:15.250Z" (ISO 8601).
[[nodiscard]] std::string moment_text(Moment moment);

// Parses "2024-05-01", "2024-05-01T12:30" or "2024-05-01 12:30:15.25". "Z", "+02:00" or nothing
// (UTC) may follow a time. A duration as below means that long before `now`. A date alone is its
// first moment, or its last one with `end_of_day`. Years 1970 to 9999. Throws UsageError, which
// names `what`.
[[nodiscard]] Moment parse_moment(std::string_view text, Moment now, bool end_of_day,
                                  std::string_view what);

// Parses "90s", "15m", "12h", "30d", "6w": a whole number and its unit, up to ten thousand weeks.
// Throws UsageError, which names `what`.
[[nodiscard]] std::chrono::milliseconds parse_duration(std::string_view text,
                                                       std::string_view what);

[[nodiscard]] Moment moment_now();

}  // namespace tarsier::plate
