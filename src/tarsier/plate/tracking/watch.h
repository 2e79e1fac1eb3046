// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/tracking/event.h"

#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

// Plates that matter: a list of them in a text file, and which events they match.
namespace tarsier::plate {

// How far apart two texts are, where a pattern may hold '*' (any characters) and '?' (any one):
// the least sum of edits. A character put in or left out costs 1, one replaced by another costs 1,
// or 0.25 or 0.5 where the reader that ships confuses the two often or sometimes (0 and O, 8 and
// B). 0 for equal texts.
[[nodiscard]] double reading_distance(std::string_view pattern, std::string_view text);

// What the reader that ships takes one symbol of kAlphabet for the other by: 0 for the same,
// 0.25, 0.5, or 1.
[[nodiscard]] double confusion_cost(char a, char b);

// A time of the day, of a clock on the wall of the place.
struct LocalTime {
  int weekday = 0;  // 0 Monday .. 6 Sunday
  int minute = 0;   // since midnight, 0..1439
};
// By the time zone of the machine ($TZ).
[[nodiscard]] LocalTime local_time(Moment moment);

struct WatchEntry {
  std::string plate;                   // pattern: upper case, '*' and '?'; 1..64 characters
  std::string label;                   // one line of text, 200 bytes at most; may be empty
  double errors = kDefaultErrors;      // largest reading_distance() that is tolerated, 0..3
  std::optional<Direction> direction;  // only vehicles that move so
  struct Hours {
    int from = 0;  // minutes since midnight, 0..1439
    int to = 0;    // 1..1440, not included; where it is before `from`, of the next day
  };
  std::vector<Hours> hours;  // empty: all day
  unsigned days = kAllDays;  // bit 0 Monday .. bit 6 Sunday; the day on which the hours begin
  std::string comment;       // lines above it in the file, each with '#' and its end

  static constexpr double kDefaultErrors = 0.25;
  static constexpr double kMaxErrors = 3;
  static constexpr unsigned kAllDays = 0x7F;

  // Throws std::invalid_argument for what lies outside these ranges.
  void check() const;
};

struct WatchMatch {
  const WatchEntry* entry = nullptr;
  double distance = 0;
};

// Entries in the order of the file:
//
//   # the depot's gate
//   plate,label,errors,direction,hours,days
//   2471KFD,Ann,0.25,,,
//   B-AB*,van,0,approaching,06:00-20:00,mon-fri
//
// A record a line (RFC 4180), '#' begins a comment line. The first record may name the columns, in
// any order; without one they are these. Columns that are empty or missing: 0.25 errors, any
// direction, at any time. `hours`: one range or several, with spaces between; 22:00-06:00 goes
// over midnight. `days`: mon-fri, "sat sun".
class WatchList {
 public:
  // At most 16 MB and 100,000 entries. Throws InputError with `name` and the line.
  [[nodiscard]] static WatchList parse(std::string_view text, const std::string& name);
  [[nodiscard]] static WatchList read(const std::string& path);
  [[nodiscard]] std::string text() const;     // as above, with comments
  void write(const std::string& path) const;  // whole or not at all; throws OutputError

  [[nodiscard]] const std::vector<WatchEntry>& entries() const { return entries_; }
  // In the place of an entry of the same plate, if there is one (true), else at the end.
  bool add(WatchEntry entry);
  bool remove(std::string_view plate);  // false: there is none

  // The entries that fit a text that was seen at such a time, the nearest first, then as listed.
  // `directions`: those of the vehicle; nullptr: not asked for.
  [[nodiscard]] std::vector<WatchMatch> matches(std::string_view text, const LocalTime& when,
                                                const std::vector<Direction>* directions) const;

  // The nearest entry of a vehicle. Of its candidates those count that have a tenth of the text's
  // confidence at least, kCandidateCost farther than the text itself would be. Valid until the list
  // changes.
  static constexpr double kCandidateCost = 0.25;
  [[nodiscard]] std::optional<WatchMatch> find(const PlateEvent& event,
                                               const LocalTime& when) const;

 private:
  std::vector<WatchEntry> entries_;
  std::string last_comment_;
};

// What people write in the columns and flags. Throw UsageError naming `what`.
[[nodiscard]] std::vector<WatchEntry::Hours> parse_hours(std::string_view text,
                                                         std::string_view what);
[[nodiscard]] unsigned parse_days(std::string_view text, std::string_view what);
[[nodiscard]] Direction parse_direction(std::string_view text, std::string_view what);
[[nodiscard]] std::string checked_label(std::string_view text, std::string_view what);
[[nodiscard]] std::string hours_text(const std::vector<WatchEntry::Hours>& hours);
[[nodiscard]] std::string days_text(unsigned days);  // "" for all

// {"label","entry","distance"}: entry is the pattern.
[[nodiscard]] nlohmann::ordered_json watch_json(const WatchMatch& match);
// {"plate","label","errors","direction","hours","days"}; null where any.
[[nodiscard]] nlohmann::ordered_json watch_entry_json(const WatchEntry& entry);

// A list that people change while a program runs: read when the file has changed.
class WatchFile {
 public:
  explicit WatchFile(std::string path);  // throws InputError
  // As the file says now. Where it is broken or gone, a warning says so once, and the list is that
  // of before.
  [[nodiscard]] const WatchList& current();

 private:
  struct Stamp {
    std::int64_t device = 0, inode = 0, size = 0, seconds = 0, nanoseconds = 0;
    bool operator==(const Stamp&) const = default;
  };
  [[nodiscard]] static Stamp stamp_of(const std::string& path);
  std::string path_;
  Stamp stamp_;
  WatchList list_;
};

}  // namespace tarsier::plate
