// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/tracking/event.h"

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

// Watch lists: plates listed in a text file, and the events that match them.
namespace tarsier::plate {

// Distance of two texts: the minimum sum of edit costs. The pattern may hold '*' (any characters)
// and '?' (any one). An insertion, deletion or substitution costs 1. A substitution costs only 0.25
// or 0.5 if the shipped reader confuses the two symbols often or sometimes (0 and O, 8 and B). 0
// for equal texts.
[[nodiscard]] double reading_distance(std::string_view pattern, std::string_view text);

// Cost of a substitution of two symbols of kAlphabet, by the confusions of the shipped reader: 0
// for equal symbols, 0.25, 0.5, or 1.
[[nodiscard]] double confusion_cost(char a, char b);

// A local time of the day.
struct LocalTime {
  int weekday = 0;  // 0 Monday .. 6 Sunday
  int minute = 0;   // since midnight, 0..1439
};
// By the machine's time zone ($TZ).
[[nodiscard]] LocalTime local_time(Moment moment);

struct WatchEntry {
  std::string plate;                   // pattern: upper case, '*' and '?'; 1..64 characters
  std::string label;                   // one line of text, at most 200 bytes; may be empty
  double errors = kDefaultErrors;      // maximum accepted reading_distance(), 0..3
  std::optional<Direction> direction;  // only vehicles that move in this direction
  struct Hours {
    int from = 0;  // minutes since midnight, 0..1439
    int to = 0;    // 1..1440, exclusive; if before `from`, on the next day
  };
  std::vector<Hours> hours;  // empty: all day
  unsigned days = kAllDays;  // bit 0 Monday .. bit 6 Sunday; the day on which the hours begin
  std::string comment;       // the comment lines above the entry, each with '#' and newline

  static constexpr double kDefaultErrors = 0.25;
  static constexpr double kMaxErrors = 3;
  static constexpr unsigned kAllDays = 0x7F;

  // Throws std::invalid_argument for values outside these ranges.
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
// One record per line (RFC 4180); '#' begins a comment line. The first record may name the columns,
// in any order; without it the order is the one above. Defaults of empty or missing columns: 0.25
// errors, any direction, any time. `hours` is one range or several, separated by spaces;
// 22:00-06:00 ends on the next day. `days`: mon-fri, "sat sun".
class WatchList {
 public:
  // At most 16 MB and 100,000 entries. Throws InputError, which names `name` and the line.
  [[nodiscard]] static WatchList parse(std::string_view text, const std::string& name);
  [[nodiscard]] static WatchList read(const std::string& path);
  [[nodiscard]] std::string text() const;     // in the format above, with comments
  void write(const std::string& path) const;  // atomic; throws OutputError

  [[nodiscard]] const std::vector<WatchEntry>& entries() const { return entries_; }
  // Replaces the entry of the same plate and returns true, or appends the entry and returns false.
  bool add(WatchEntry entry);
  bool remove(std::string_view plate);  // false if there is no such entry

  // The entries that match a text seen at `when`, nearest first, then in the order of the list.
  // `directions` are those of the vehicle; nullptr disables this check.
  [[nodiscard]] std::vector<WatchMatch> matches(std::string_view text, const LocalTime& when,
                                                const std::vector<Direction>* directions) const;

  // The nearest entry of a vehicle. It compares the candidates whose confidence is at least a tenth
  // of the text's; a candidate adds kCandidateCost to the distance. Valid until the list changes.
  static constexpr double kCandidateCost = 0.25;
  [[nodiscard]] std::optional<WatchMatch> find(const PlateEvent& event,
                                               const LocalTime& when) const;

 private:
  std::vector<WatchEntry> entries_;
  std::string last_comment_;
};

// Parse the columns and flags. Throw UsageError, which names `what`.
[[nodiscard]] std::vector<WatchEntry::Hours> parse_hours(std::string_view text,
                                                         std::string_view what);
[[nodiscard]] unsigned parse_days(std::string_view text, std::string_view what);
[[nodiscard]] Direction parse_direction(std::string_view text, std::string_view what);
[[nodiscard]] std::string checked_label(std::string_view text, std::string_view what);
[[nodiscard]] std::string hours_text(const std::vector<WatchEntry::Hours>& hours);
[[nodiscard]] std::string days_text(unsigned days);  // "" for all days

// {"label","entry","distance"}; "entry" is the pattern.
[[nodiscard]] nlohmann::ordered_json watch_json(const WatchMatch& match);
// {"plate","label","errors","direction","hours","days"}; null means any.
[[nodiscard]] nlohmann::ordered_json watch_entry_json(const WatchEntry& entry);

// A list that users edit while a program runs. It is read again when the file has changed.
class WatchFile {
 public:
  explicit WatchFile(std::string path);  // throws InputError
  // The present list of the file. If the file is broken or missing, the previous list stays in use
  // and a warning is logged once.
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
