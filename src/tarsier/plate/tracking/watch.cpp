// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/watch.h"

#include "tarsier/core/csv.h"
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/core/words.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/plate/text/text.h"
#include "tarsier/plate/tracking/log.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <ctime>
#include <nlohmann/json.hpp>
#include <sys/stat.h>
#include <utility>

namespace tarsier::plate {
namespace {

constexpr std::int64_t kMaxBytes = 16'000'000;
constexpr std::size_t kMaxEntries = 100'000;
constexpr std::size_t kMaxPattern = 64;  // characters
constexpr std::size_t kMaxLabel = 200;   // bytes
constexpr int kMinutesPerDay = 24 * 60;

// On 1000 synthetic cars (`plate synth --kind spain,europe,us,brazil,spain-old --size 640x360
// --noise 6 --seed 77`) the shipped reader got 498 of 4892 characters wrong, in texts of the right
// length with at most three errors. First come pairs of similar shape, then pairs with four errors
// or more. The latter are mostly two digits or two letters, so another vehicle may have that text.
constexpr std::string_view kFrequentConfusions = "8B 0D 0O 0Q DO DQ OQ 2Z 5S 6G 1I";
constexpr std::string_view kOccasionalConfusions =
    "NW 68 27 VW 56 03 59 MN WY HW 6E 08 89 9B VY HM 58 HR RW 1T 3J 8W IJ KX FP 37";
constexpr double kFrequentCost = 0.25;
constexpr double kOccasionalCost = 0.5;

using CostTable = std::array<std::array<double, kAlphabet.size()>, kAlphabet.size()>;

constexpr CostTable make_costs() {
  CostTable costs{};
  for (auto& row : costs) {
    for (double& cost : row) cost = 1;
  }
  for (std::size_t k = 0; k < kAlphabet.size(); ++k) costs[k][k] = 0;
  const auto set = [&costs](std::string_view pairs, double cost) {
    for (std::size_t at = 0; at + 1 < pairs.size(); at += 3) {
      const std::size_t a = kAlphabet.find(pairs[at]);
      const std::size_t b = kAlphabet.find(pairs[at + 1]);
      costs[a][b] = cost;
      costs[b][a] = cost;
    }
  };
  set(kOccasionalConfusions, kOccasionalCost);
  set(kFrequentConfusions, kFrequentCost);
  return costs;
}

constexpr CostTable kCosts = make_costs();

constexpr std::array<std::string_view, 7> kDays{"mon", "tue", "wed", "thu", "fri", "sat", "sun"};
constexpr std::array<std::string_view, 6> kColumns{"plate",     "label", "errors",
                                                   "direction", "hours", "days"};

[[noreturn]] void refuse(std::string_view what, std::string_view text,
                         const std::string& expected) {
  throw UsageError(fmt::format("{} '{}': {}", what, printable(text), expected));
}

// Minutes of "22:00"; 24:00 is allowed with `end`.
std::optional<int> minute_of(std::string_view text, bool end) {
  const std::size_t colon = text.find(':');
  if (colon == std::string_view::npos || colon == 0 || colon > 2 || text.size() - colon != 3)
    return std::nullopt;
  const auto hour = to_integer(text.substr(0, colon), 0, 24);
  const auto minute = to_integer(text.substr(colon + 1), 0, 59);
  if (!hour || !minute) return std::nullopt;
  const auto total = static_cast<int>(*hour * 60 + *minute);
  if (total > kMinutesPerDay || (total == kMinutesPerDay && !end)) return std::nullopt;
  return total;
}

std::string minute_text(int minute) { return fmt::format("{:02}:{:02}", minute / 60, minute % 60); }

std::optional<int> day_of(std::string_view text) {
  const std::string day = lower_case(text);
  const auto* const at = std::find(kDays.begin(), kDays.end(), day);
  if (at == kDays.end()) return std::nullopt;
  return static_cast<int>(at - kDays.begin());
}

bool has_day(unsigned days, int day) { return (days >> static_cast<unsigned>(day) & 1U) != 0; }

bool is_active_at(const WatchEntry& entry, const LocalTime& when) {
  if (entry.hours.empty()) return has_day(entry.days, when.weekday);
  return std::any_of(entry.hours.begin(), entry.hours.end(), [&](const WatchEntry::Hours& hours) {
    if (hours.from < hours.to) {
      return when.minute >= hours.from && when.minute < hours.to &&
             has_day(entry.days, when.weekday);
    }
    if (when.minute >= hours.from) return has_day(entry.days, when.weekday);
    return when.minute < hours.to && has_day(entry.days, (when.weekday + 6) % 7);
  });
}

// Undoes the escaping by csv_line() of fields that a spreadsheet would take for a formula.
std::string without_apostrophe(std::string field) {
  constexpr std::string_view kFormula = "=+-@";
  if (field.size() >= 2 && field[0] == '\'' && kFormula.find(field[1]) != std::string_view::npos)
    field.erase(0, 1);
  return field;
}

bool is_label(std::string_view text) {
  return text.size() <= kMaxLabel && std::none_of(text.begin(), text.end(), [](char c) {
           return static_cast<unsigned char>(c) < 0x20 || c == 0x7F;
         });
}

// For each field of the header: its index in kColumns.
std::vector<std::size_t> columns_of(const std::vector<std::string>& names) {
  std::vector<std::size_t> columns;
  for (const std::string& name : names) {
    const std::string column = lower_case(trimmed(name));
    const auto* const at = std::find(kColumns.begin(), kColumns.end(), column);
    if (at == kColumns.end())
      refuse("column", name, fmt::format("expected {}", fmt::join(kColumns, ", ")));
    columns.push_back(static_cast<std::size_t>(at - kColumns.begin()));
    if (std::count(columns.begin(), columns.end(), columns.back()) > 1)
      refuse("column", name, "is there twice");
  }
  return columns;
}

bool is_header(const std::vector<std::string>& fields) {
  return std::any_of(fields.begin(), fields.end(), [](const std::string& field) {
    return lower_case(trimmed(field)) == kColumns[0];
  });
}

double parse_errors(std::string_view text) {
  const auto errors = to_number(text);
  if (!errors || *errors < 0 || *errors > WatchEntry::kMaxErrors)
    refuse("errors", text, fmt::format("expected 0..{:g}", WatchEntry::kMaxErrors));
  return *errors;
}

WatchEntry entry_of(const std::vector<std::string>& fields,
                    const std::vector<std::size_t>& columns) {
  WatchEntry entry;
  for (std::size_t k = 0; k < fields.size(); ++k) {
    const std::string field = without_apostrophe(std::string(trimmed(fields[k])));
    if (k >= columns.size()) {
      if (!field.empty())
        throw UsageError(fmt::format("{} fields, of {} columns", fields.size(), columns.size()));
      continue;
    }
    if (field.empty()) continue;
    switch (columns[k]) {
      case 0:
        entry.plate = plate_pattern(field, "plate");
        break;
      case 1:
        entry.label = checked_label(field, "label");
        break;
      case 2:
        entry.errors = parse_errors(field);
        break;
      case 3:
        entry.direction = parse_direction(field, "direction");
        break;
      case 4:
        entry.hours = parse_hours(field, "hours");
        break;
      default:
        entry.days = parse_days(field, "days");
    }
  }
  if (entry.plate.empty()) throw UsageError("the plate is missing");
  return entry;
}

}  // namespace

double confusion_cost(char a, char b) {
  const int from = class_of(a);
  const int to = class_of(b);
  if (from < 0 || to < 0) return a == b ? 0 : 1;
  return kCosts[static_cast<std::size_t>(from)][static_cast<std::size_t>(to)];
}

double reading_distance(std::string_view pattern, std::string_view text) {
  std::vector<double> row(text.size() + 1);
  for (std::size_t j = 0; j < row.size(); ++j) row[j] = static_cast<double>(j);
  for (const char c : pattern) {
    double diagonal = row[0];
    row[0] += c == '*' ? 0 : 1;
    for (std::size_t j = 1; j < row.size(); ++j) {
      const double above = row[j];
      if (c == '*') {
        row[j] = std::min(above, row[j - 1]);
      } else {
        const double replaced = c == '?' ? 0 : confusion_cost(c, text[j - 1]);
        row[j] = std::min({diagonal + replaced, above + 1, row[j - 1] + 1});
      }
      diagonal = above;
    }
  }
  return row.back();
}

LocalTime local_time(Moment moment) {
  const auto seconds = static_cast<std::time_t>(
      std::chrono::floor<std::chrono::seconds>(moment).time_since_epoch().count());
  std::tm parts{};
  if (::localtime_r(&seconds, &parts) == nullptr) return {};
  return {(parts.tm_wday + 6) % 7, parts.tm_hour * 60 + parts.tm_min};
}

void WatchEntry::check() const {
  TARSIER_REQUIRE(!plate.empty() && plate.size() <= kMaxPattern, "a plate of {} characters",
                  plate.size());
  for (const char c : plate)
    TARSIER_REQUIRE(class_of(c) >= 0 || c == '*' || c == '?', "the plate '{}'", printable(plate));
  TARSIER_REQUIRE(is_label(label), "a label of {} bytes", label.size());
  TARSIER_REQUIRE(errors >= 0 && errors <= kMaxErrors, "{} errors", errors);
  for (const Hours& range : hours) {
    TARSIER_REQUIRE(range.from >= 0 && range.from < kMinutesPerDay && range.to > 0 &&
                        range.to <= kMinutesPerDay && range.from != range.to,
                    "hours from {} to {}", range.from, range.to);
  }
  TARSIER_REQUIRE(days > 0 && days <= kAllDays, "days {}", days);
}

std::vector<WatchEntry::Hours> parse_hours(std::string_view text, std::string_view what) {
  std::vector<WatchEntry::Hours> ranges;
  std::string_view rest = text;
  while (!trimmed(rest).empty()) {
    const std::string_view word = next_word(rest);
    const std::size_t dash = word.find('-');
    std::optional<int> from;
    std::optional<int> to;
    if (dash != std::string_view::npos) {
      from = minute_of(word.substr(0, dash), false);
      to = minute_of(word.substr(dash + 1), true);
    }
    if (!from || !to || from == to || ranges.size() == 24)
      refuse(what, text, "expected 08:00-18:00, with spaces between several");
    ranges.push_back({*from, *to == 0 ? kMinutesPerDay : *to});
  }
  return ranges;
}

unsigned parse_days(std::string_view text, std::string_view what) {
  unsigned days = 0;
  std::string_view rest = text;
  while (!trimmed(rest).empty()) {
    const std::string_view word = next_word(rest);
    const std::size_t dash = word.find('-');
    const auto from = day_of(word.substr(0, dash));
    const auto to = dash == std::string_view::npos ? from : day_of(word.substr(dash + 1));
    if (!from || !to) refuse(what, text, "expected days as mon-fri or 'sat sun'");
    for (int day = *from;; day = (day + 1) % 7) {
      days |= 1U << static_cast<unsigned>(day);
      if (day == *to) break;
    }
  }
  return days == 0 ? WatchEntry::kAllDays : days;
}

Direction parse_direction(std::string_view text, std::string_view what) {
  const std::string word = lower_case(trimmed(text));
  std::string names;
  for (const Direction direction : kDirections) {
    if (word == name_of(direction)) return direction;
    if (!names.empty()) names += ", ";
    names += name_of(direction);
  }
  refuse(what, text, "expected one of " + names);
}

std::string checked_label(std::string_view text, std::string_view what) {
  if (!is_label(text))
    refuse(what, text.substr(0, 50),
           fmt::format("expected one line of {} bytes at most", kMaxLabel));
  return std::string(text);
}

std::string hours_text(const std::vector<WatchEntry::Hours>& hours) {
  std::string text;
  for (const WatchEntry::Hours& range : hours) {
    if (!text.empty()) text += ' ';
    text += minute_text(range.from) + '-' + minute_text(range.to);
  }
  return text;
}

std::string days_text(unsigned days) {
  std::string text;
  if (days == WatchEntry::kAllDays) return text;
  for (int day = 0; day < 7; ++day) {
    if (!has_day(days, day)) continue;
    int last = day;
    while (last < 6 && has_day(days, last + 1)) ++last;
    if (!text.empty()) text += ' ';
    text += kDays[static_cast<std::size_t>(day)];
    if (last > day) text.append("-").append(kDays[static_cast<std::size_t>(last)]);
    day = last;
  }
  return text;
}

WatchList WatchList::parse(std::string_view text, const std::string& name) {
  WatchList list;
  constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
  if (text.starts_with(kByteOrderMark)) text.remove_prefix(kByteOrderMark.size());
  std::vector<std::size_t> columns{0, 1, 2, 3, 4, 5};
  std::string comment;
  bool is_first = true;
  for (int number = 1; !text.empty(); ++number) {
    const std::string_view line = trimmed(next_line(text));
    if (line.empty()) continue;
    if (line.front() == '#') {
      comment += std::string(line) + '\n';
      continue;
    }
    try {
      const auto fields = csv_fields(line);
      if (!fields) throw UsageError("a quote is not closed, or stands within a field");
      if (std::exchange(is_first, false) && is_header(*fields)) {
        columns = columns_of(*fields);
        continue;
      }
      WatchEntry entry = entry_of(*fields, columns);
      entry.comment = std::exchange(comment, {});
      if (list.entries_.size() == kMaxEntries)
        throw UsageError(fmt::format("more than {} entries", kMaxEntries));
      list.entries_.push_back(std::move(entry));
    } catch (const UsageError& error) {
      throw InputError(name, fmt::format("line {}: {}", number, error.what()));
    }
  }
  list.last_comment_ = std::move(comment);
  return list;
}

WatchList WatchList::read(const std::string& path) {
  return parse(read_file(path, kMaxBytes), path);
}

std::string WatchList::text() const {
  // The first comment mostly belongs to the file.
  std::string text = entries_.empty() ? "" : entries_.front().comment;
  text += csv_line({kColumns.begin(), kColumns.end()});
  for (const WatchEntry& entry : entries_) {
    if (&entry != &entries_.front()) text += entry.comment;
    text += csv_line({entry.plate, entry.label, fmt::format("{:g}", entry.errors),
                      entry.direction ? std::string(name_of(*entry.direction)) : std::string(),
                      hours_text(entry.hours), days_text(entry.days)});
  }
  return text + last_comment_;
}

void WatchList::write(const std::string& path) const { write_file_atomically(path, text()); }

bool WatchList::add(WatchEntry entry) {
  entry.check();
  const auto same = std::find_if(entries_.begin(), entries_.end(), [&](const WatchEntry& other) {
    return other.plate == entry.plate;
  });
  if (same == entries_.end()) {
    TARSIER_REQUIRE(entries_.size() < kMaxEntries, "more than {} entries", kMaxEntries);
    entries_.push_back(std::move(entry));
    return false;
  }
  entry.comment = std::move(same->comment);
  *same = std::move(entry);
  return true;
}

bool WatchList::remove(std::string_view plate) {
  const auto at = std::find_if(entries_.begin(), entries_.end(),
                               [&](const WatchEntry& entry) { return entry.plate == plate; });
  if (at == entries_.end()) return false;
  // The comment of the first entry belongs to the file.
  const bool is_first = at == entries_.begin();
  const std::string comment = std::move(at->comment);
  const auto next = entries_.erase(at);
  if (is_first && !comment.empty()) {
    std::string& below = next == entries_.end() ? last_comment_ : next->comment;
    below = comment + below;
  }
  return true;
}

std::vector<WatchMatch> WatchList::matches(std::string_view text, const LocalTime& when,
                                           const std::vector<Direction>* directions) const {
  std::vector<WatchMatch> results;
  for (const WatchEntry& entry : entries_) {
    if (!is_active_at(entry, when)) continue;
    if (directions != nullptr && entry.direction &&
        std::find(directions->begin(), directions->end(), *entry.direction) == directions->end())
      continue;
    if (entry.plate.find('*') == std::string::npos) {
      const auto longer = std::max(entry.plate.size(), text.size());
      const auto shorter = std::min(entry.plate.size(), text.size());
      if (static_cast<double>(longer - shorter) > entry.errors) continue;
    }
    const double distance = reading_distance(entry.plate, text);
    if (distance <= entry.errors) results.push_back({&entry, distance});
  }
  std::stable_sort(results.begin(), results.end(), [](const WatchMatch& a, const WatchMatch& b) {
    return a.distance < b.distance;
  });
  return results;
}

std::optional<WatchMatch> WatchList::find(const PlateEvent& event, const LocalTime& when) const {
  constexpr double kMinShare = 0.1;
  const std::vector<Direction> directions = directions_of(event);
  std::optional<WatchMatch> best;
  const auto consider = [&](const std::string& text, double extra_cost) {
    for (const WatchMatch& match : matches(text, when, &directions)) {
      const double distance = match.distance + extra_cost;
      if (distance > match.entry->errors || (best && best->distance <= distance)) continue;
      best = {match.entry, distance};
    }
  };
  if (event.text.empty()) return best;
  consider(event.text, 0);
  for (const Candidate& candidate : event.candidates) {
    if (candidate.text != event.text && !candidate.text.empty() &&
        candidate.confidence >= kMinShare * event.confidence)
      consider(candidate.text, kCandidateCost);
  }
  return best;
}

nlohmann::ordered_json watch_json(const WatchMatch& match) {
  return {{"label", match.entry->label},
          {"entry", match.entry->plate},
          {"distance", std::round(match.distance * 100) / 100}};
}

nlohmann::ordered_json watch_entry_json(const WatchEntry& entry) {
  const auto or_null = [](const std::string& text) {
    return text.empty() ? nlohmann::ordered_json() : nlohmann::ordered_json(text);
  };
  return {{"plate", entry.plate},
          {"label", entry.label},
          {"errors", entry.errors},
          {"direction", or_null(entry.direction ? std::string(name_of(*entry.direction)) : "")},
          {"hours", or_null(hours_text(entry.hours))},
          {"days", or_null(days_text(entry.days))}};
}

WatchFile::WatchFile(std::string path)
    : path_(std::move(path)), stamp_(stamp_of(path_)), list_(WatchList::read(path_)) {}

WatchFile::Stamp WatchFile::stamp_of(const std::string& path) {
  struct ::stat info {};
  if (::stat(path.c_str(), &info) != 0) return {};
  return {static_cast<std::int64_t>(info.st_dev), static_cast<std::int64_t>(info.st_ino),
          info.st_size, info.st_mtim.tv_sec, info.st_mtim.tv_nsec};
}

const WatchList& WatchFile::current() {
  const Stamp now = stamp_of(path_);
  if (now == stamp_) return list_;
  stamp_ = now;
  try {
    list_ = WatchList::read(path_);
    log_info("{}: has changed and was reloaded, {} entries", path_, list_.entries().size());
  } catch (const InputError& error) {
    log_warning("{}; the previous {} entries stay in use", error.what(), list_.entries().size());
  }
  return list_;
}

}  // namespace tarsier::plate
