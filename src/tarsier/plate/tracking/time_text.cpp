// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/time_text.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"

#include <fmt/format.h>

#include <charconv>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <system_error>

namespace tarsier::plate {
namespace {

namespace chrono = std::chrono;
using std::chrono::milliseconds;

// Parses a text from its front; sets `good` to false on a mismatch.
struct Scanner {
  std::string_view rest;
  bool good = true;

  bool take(char c) {
    if (rest.empty() || rest.front() != c) return false;
    rest.remove_prefix(1);
    return true;
  }
  void need(char c) { good = good && take(c); }
  int number(std::size_t digits, int min, int max) {
    int value = 0;
    for (std::size_t k = 0; k < digits; ++k) {
      if (k >= rest.size() || rest[k] < '0' || rest[k] > '9') {
        good = false;
        return min;
      }
      value = 10 * value + (rest[k] - '0');
    }
    rest.remove_prefix(digits);
    good = good && value >= min && value <= max;
    return value;
  }
};

milliseconds fraction(Scanner& scan) {
  int value = 0;
  int digits = 0;
  for (; !scan.rest.empty() && scan.rest.front() >= '0' && scan.rest.front() <= '9'; ++digits) {
    if (digits < 3) value = 10 * value + (scan.rest.front() - '0');
    scan.rest.remove_prefix(1);
  }
  if (digits == 0) scan.good = false;
  for (; digits < 3; ++digits) value *= 10;
  return milliseconds(value);
}

milliseconds zone(Scanner& scan) {
  if (scan.take('Z') || scan.rest.empty()) return milliseconds(0);
  const bool west = scan.take('-');
  if (!west) scan.need('+');
  const chrono::hours whole(scan.number(2, 0, 18));
  scan.need(':');
  const milliseconds offset = whole + chrono::minutes(scan.number(2, 0, 59));
  return west ? -offset : offset;
}

std::optional<Moment> scan_moment(std::string_view text, bool end_of_day) {
  Scanner scan{text};
  const std::chrono::year year(scan.number(4, 1970, 9999));
  scan.need('-');
  const std::chrono::month month(static_cast<unsigned>(scan.number(2, 1, 12)));
  scan.need('-');
  const std::chrono::year_month_day day(
      year, month, std::chrono::day(static_cast<unsigned>(scan.number(2, 1, 31))));
  if (!scan.good || !day.ok()) return std::nullopt;
  Moment moment = std::chrono::sys_days(day);
  if (scan.rest.empty()) return end_of_day ? moment + chrono::days(1) - milliseconds(1) : moment;
  if (!scan.take('T')) scan.need(' ');
  moment += chrono::hours(scan.number(2, 0, 23));
  scan.need(':');
  moment += chrono::minutes(scan.number(2, 0, 59));
  if (scan.take(':')) {
    moment += chrono::seconds(scan.number(2, 0, 59));
    if (scan.take('.')) moment += fraction(scan);
  }
  moment -= zone(scan);
  if (!scan.good || !scan.rest.empty()) return std::nullopt;
  return moment;
}

std::optional<milliseconds> scan_duration(std::string_view text) {
  if (text.size() < 2) return std::nullopt;
  std::int64_t count = 0;
  const char* end = text.data() + text.size() - 1;
  const auto [after, error] = std::from_chars(text.data(), end, count);
  if (error != std::errc() || after != end || count < 0 || count > 10'000'000'000) {
    return std::nullopt;
  }
  milliseconds unit{};
  switch (text.back()) {
    case 's':
      unit = chrono::seconds(1);
      break;
    case 'm':
      unit = chrono::minutes(1);
      break;
    case 'h':
      unit = chrono::hours(1);
      break;
    case 'd':
      unit = chrono::days(1);
      break;
    case 'w':
      unit = chrono::weeks(1);
      break;
    default:
      return std::nullopt;
  }
  if (count > milliseconds(chrono::weeks(10'000)) / unit) return std::nullopt;
  return count * unit;
}

}  // namespace

std::string moment_text(Moment moment) {
  const auto day = std::chrono::floor<chrono::days>(moment);
  const std::chrono::year_month_day date(day);
  const std::chrono::hh_mm_ss<milliseconds> time(moment - day);
  return fmt::format("{:04}-{:02}-{:02}T{:02}:{:02}:{:02}.{:03}Z", static_cast<int>(date.year()),
                     static_cast<unsigned>(date.month()), static_cast<unsigned>(date.day()),
                     time.hours().count(), time.minutes().count(), time.seconds().count(),
                     time.subseconds().count());
}

Moment parse_moment(std::string_view text, Moment now, bool end_of_day, std::string_view what) {
  if (const auto moment = scan_moment(text, end_of_day)) return *moment;
  if (const auto ago = scan_duration(text)) return now - *ago;
  throw UsageError(
      fmt::format("{} '{}': expected a time as 2024-05-01 or 2024-05-01T12:30:15Z "
                  "(UTC), or how long ago, as 12h",
                  what, printable(text)));
}

milliseconds parse_duration(std::string_view text, std::string_view what) {
  if (const auto duration = scan_duration(text)) return *duration;
  throw UsageError(
      fmt::format("{} '{}': expected a whole number and s, m, h, d or w, as 30d for thirty days",
                  what, printable(text)));
}

Moment moment_now() { return std::chrono::floor<milliseconds>(std::chrono::system_clock::now()); }

}  // namespace tarsier::plate
