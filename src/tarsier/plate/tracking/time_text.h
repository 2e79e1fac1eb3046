// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <string>
#include <string_view>

// Moments and durations as people and files write them. Moments are UTC, to the millisecond.
namespace tarsier::plate {

using Moment = std::chrono::sys_time<std::chrono::milliseconds>;

// "2024-05-01T12:30:15.250Z" (ISO 8601).
[[nodiscard]] std::string moment_text(Moment moment);

// "2024-05-01", "2024-05-01T12:30", "2024-05-01 12:30:15.25", each with "Z", "+02:00" or nothing
// (UTC) after a time, or a duration as below: so long before `now`. A day alone is its first
// moment, or its last where `end_of_day`. Years 1970 to 9999. Throws UsageError naming `what`.
[[nodiscard]] Moment parse_moment(std::string_view text, Moment now, bool end_of_day,
                                  std::string_view what);

// "90s", "15m", "12h", "30d", "6w": a whole number and its unit, up to ten thousand weeks. Throws
// UsageError naming `what`.
[[nodiscard]] std::chrono::milliseconds parse_duration(std::string_view text,
                                                       std::string_view what);

[[nodiscard]] Moment moment_now();

}  // namespace tarsier::plate
