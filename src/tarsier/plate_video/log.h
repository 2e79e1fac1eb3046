// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/io/sqlite.h"
#include "tarsier/plate_video/event.h"
#include "tarsier/plate_video/time_text.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::plate {

// A log's entry, without its picture.
struct LoggedPlate {
  std::int64_t id = 0;
  Moment first_time;
  Moment last_time;
  std::string source;
  std::string text;
  double confidence = 0;
  std::string country;
  std::int64_t frames = 0;
  cv::Rect box;            // where it was read best
  std::string candidates;  // JSON lists as event.h writes them
  std::string readings;
  bool has_crop = false;
};

struct LogFilter {
  std::string text;   // upper case; '*' is any characters, '?' any one; empty: any text
  bool near = false;  // one character may be wrong, missing or too many, and O/Q/D are 0, I is 1
  std::optional<Moment> since;  // entries that were in sight at some time from `since` ..
  std::optional<Moment> until;  // .. to `until`
  std::string source;           // as it was logged; empty: any
  std::int64_t limit = 0;       // the newest so many; 0: all
};

// A pattern as people type it ("b-12?4*"), for LogFilter::text. Throws UsageError for what no plate
// can hold.
[[nodiscard]] std::string plate_pattern(std::string_view text);

// Whether a text matches a pattern of LogFilter.
[[nodiscard]] bool matches(std::string_view pattern, std::string_view text, bool near);

// SQLite file of plates that were seen. Each entry is on the disk when append() returns. Errors as
// io/sqlite.h says; after one the log can still be used.
class PlateLog {
 public:
  explicit PlateLog(const std::string& path, DatabaseAccess access = DatabaseAccess::kCreate,
                    int patience_ms = 5000);

  // `origin` is the moment of the event's time 0. Passwords in a source are not kept. Returns the
  // entry's id. Throws OutputError.
  std::int64_t append(const PlateEvent& event, const std::string& source, Moment origin);

  // Calls take() with each entry, newest first, until it returns false. Returns how many.
  std::int64_t query(const LogFilter& filter, const std::function<bool(const LoggedPlate&)>& take);

  // JPEG bytes, empty where there is no picture.
  [[nodiscard]] std::vector<std::uint8_t> crop(std::int64_t id);

  [[nodiscard]] std::int64_t count();

  // Deletes what was last in sight before `moment`, with its pictures, and gives the room back to
  // the disk. Returns how many entries that were.
  std::int64_t forget_before(Moment moment);

 private:
  Database database_;
};

// {"id","text","confidence","country","source","first_time","last_time","frames","box","candidates",
// "readings","crop"}: times as ISO 8601, crop true or false. Throws InputError(path) where a
// hostile file holds no JSON.
[[nodiscard]] nlohmann::ordered_json logged_json(const LoggedPlate& plate, const std::string& path);

// Header and lines of the CSV form: id, first_time, last_time, source, text, confidence, country,
// frames, x, y, w, h.
[[nodiscard]] std::string logged_csv_header();
[[nodiscard]] std::string logged_csv_line(const LoggedPlate& plate);

}  // namespace tarsier::plate
