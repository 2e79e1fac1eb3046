// SPDX-License-Identifier: MIT
#include "tarsier/plate_video/log.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/io/archive.h"
#include "tarsier/io/frame_source.h"
#include "tarsier/io/image_file.h"
#include "tarsier/plate_text/csv.h"
#include "tarsier/plate_text/text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace tarsier::plate {
namespace {

constexpr int kCropQuality = 90;
constexpr std::size_t kMostSource = 1000;  // bytes

// 'TPL1'
const DatabaseKind kKind{"Tarsier plate log", 0x54504C31, {R"sql(
CREATE TABLE plate(
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  first_time INTEGER NOT NULL,  -- ms since 1970-01-01, UTC
  last_time INTEGER NOT NULL,
  source TEXT NOT NULL,
  text TEXT NOT NULL,
  confidence REAL NOT NULL,
  country TEXT NOT NULL,        -- '' where none fits
  frames INTEGER NOT NULL,
  x INTEGER NOT NULL, y INTEGER NOT NULL, w INTEGER NOT NULL, h INTEGER NOT NULL,
  candidates TEXT NOT NULL,     -- JSON
  readings TEXT NOT NULL,       -- JSON
  crop BLOB                     -- JPEG
) STRICT;
CREATE INDEX plate_by_time ON plate(last_time);
)sql"}};

std::int64_t number_of(Moment moment) { return moment.time_since_epoch().count(); }

// Years 1970 to 9999, whatever the file says.
Moment moment_of(std::int64_t number) {
  constexpr std::int64_t kEnd = 253'402'300'799'999;
  return Moment(std::chrono::milliseconds(std::clamp<std::int64_t>(number, 0, kEnd)));
}

int whole(std::int64_t number) {
  return static_cast<int>(std::clamp<std::int64_t>(number, std::numeric_limits<int>::min(),
                                                   std::numeric_limits<int>::max()));
}

// Edits between a pattern and a text; those of '*' and '?' are free. More than one is two.
int pattern_edits(std::string_view pattern, std::string_view text) {
  std::vector<int> row(text.size() + 1);
  for (std::size_t j = 0; j < row.size(); ++j) row[j] = static_cast<int>(j);
  for (const char c : pattern) {
    int diagonal = row[0];
    row[0] += c == '*' ? 0 : 1;
    for (std::size_t j = 1; j < row.size(); ++j) {
      const int above = row[j];
      if (c == '*') {
        row[j] = std::min(above, row[j - 1]);
      } else {
        const bool same = c == '?' || c == text[j - 1];
        row[j] = std::min({diagonal + (same ? 0 : 1), above + 1, row[j - 1] + 1});
      }
      diagonal = above;
    }
  }
  return row.back();
}

LoggedPlate plate_at(const Statement& row) {
  LoggedPlate plate;
  plate.id = row.integer(0);
  plate.first_time = moment_of(row.integer(1));
  plate.last_time = moment_of(row.integer(2));
  plate.source = row.text(3);
  plate.text = row.text(4);
  plate.confidence = row.real(5);
  plate.country = row.text(6);
  plate.frames = row.integer(7);
  plate.box = {whole(row.integer(8)), whole(row.integer(9)), whole(row.integer(10)),
               whole(row.integer(11))};
  plate.candidates = row.text(12);
  plate.readings = row.text(13);
  plate.has_crop = row.integer(14) != 0;
  return plate;
}

std::string dumped(const nlohmann::ordered_json& value) {
  return value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

nlohmann::ordered_json list_of(const std::string& text, const std::string& what,
                               const std::string& path) {
  try {
    return parse_json(text, path, {64'000'000, 8, 2'000'000});
  } catch (const InputError&) {
    throw InputError(path, what + " are no JSON");
  }
}

}  // namespace

std::string plate_pattern(std::string_view text) {
  std::string pattern;
  for (const char c : text) {
    if (c == ' ' || c == '-') continue;
    const char upper = c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
    if (class_of(upper) < 0 && upper != '*' && upper != '?') {
      throw UsageError(
          fmt::format("--text '{}': letters, digits, '*' (any characters) and '?' (any "
                      "one) are expected",
                      printable(text)));
    }
    pattern += upper;
  }
  if (pattern.empty() || pattern.size() > 64) {
    throw UsageError(
        fmt::format("--text '{}': one to 64 characters are expected", printable(text)));
  }
  return pattern;
}

bool matches(std::string_view pattern, std::string_view text, bool near) {
  if (!near) return pattern_edits(pattern, text) == 0;
  return pattern_edits(fold_symbols(pattern), fold_symbols(text)) <= 1;
}

PlateLog::PlateLog(const std::string& path, DatabaseAccess access, int patience_ms)
    : database_(path, kKind, access, patience_ms) {}

std::int64_t PlateLog::append(const PlateEvent& event, const std::string& source, Moment origin) {
  const auto moment = [&](double seconds) {
    TARSIER_REQUIRE(std::isfinite(seconds) && std::abs(seconds) < 1e10, "time {} s", seconds);
    return number_of(origin + std::chrono::milliseconds(std::llround(1000 * seconds)));
  };
  const std::string shown = masked(source);
  std::vector<std::uint8_t> crop;
  if (!event.best_crop.empty()) {
    crop = encode_image(".jpg", event.best_crop, database_.path(), kCropQuality);
  }
  Statement insert(database_,
                   "INSERT INTO plate(first_time, last_time, source, text, confidence, country, "
                   "frames, x, y, w, h, candidates, readings, crop) "
                   "VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  insert.bind(1, moment(event.first_time))
      .bind(2, moment(event.last_time))
      .bind(3, std::string_view(shown).substr(0, kMostSource))
      .bind(4, std::string_view(event.text))
      .bind(5, std::isfinite(event.confidence) ? event.confidence : 0.0)
      .bind(6, std::string_view(event.country))
      .bind(7, event.frames)
      .bind(8, std::int64_t{event.best_box.x})
      .bind(9, std::int64_t{event.best_box.y})
      .bind(10, std::int64_t{event.best_box.width})
      .bind(11, std::int64_t{event.best_box.height})
      .bind(12, std::string_view(dumped(candidates_json(event.candidates))))
      .bind(13, std::string_view(dumped(readings_json(event.readings))));
  if (crop.empty()) {
    insert.bind_null(14);
  } else {
    insert.bind(14, std::span<const std::uint8_t>(crop));
  }
  (void)insert.step();
  return database_.last_row_id();
}

std::int64_t PlateLog::query(const LogFilter& filter,
                             const std::function<bool(const LoggedPlate&)>& take) {
  // The pattern is matched here: it can be near.
  Statement rows(database_,
                 "SELECT id, first_time, last_time, source, text, confidence, country, frames, "
                 "x, y, w, h, candidates, readings, crop IS NOT NULL FROM plate "
                 "WHERE last_time >= ? AND first_time <= ? AND (? = '' OR source = ?) "
                 "ORDER BY last_time DESC, id DESC");
  constexpr std::int64_t kFarthest = std::numeric_limits<std::int64_t>::max();
  rows.bind(1, filter.since ? number_of(*filter.since) : -kFarthest)
      .bind(2, filter.until ? number_of(*filter.until) : kFarthest)
      .bind(3, std::string_view(filter.source))
      .bind(4, std::string_view(filter.source));
  std::int64_t found = 0;
  while ((filter.limit <= 0 || found < filter.limit) && rows.step()) {
    if (!filter.text.empty() && !matches(filter.text, rows.text(4), filter.near)) continue;
    ++found;
    if (!take(plate_at(rows))) break;
  }
  return found;
}

std::vector<std::uint8_t> PlateLog::crop(std::int64_t id) {
  Statement row(database_, "SELECT crop FROM plate WHERE id = ?");
  row.bind(1, id);
  return row.step() ? row.bytes(0) : std::vector<std::uint8_t>();
}

std::int64_t PlateLog::count() {
  Statement row(database_, "SELECT count(*) FROM plate");
  return row.step() ? row.integer(0) : 0;
}

std::int64_t PlateLog::forget_before(Moment moment) {
  {
    Statement remove(database_, "DELETE FROM plate WHERE last_time < ?");
    remove.bind(1, number_of(moment)).step();
  }
  const std::int64_t removed = database_.changed_rows();
  if (removed == 0) return 0;
  // The room is given back page by page, and the write-ahead log with the old pages is emptied.
  database_.run("PRAGMA incremental_vacuum; PRAGMA wal_checkpoint(TRUNCATE)");
  return removed;
}

nlohmann::ordered_json logged_json(const LoggedPlate& plate, const std::string& path) {
  const std::string what = fmt::format("entry {}: its ", plate.id);
  return {{"id", plate.id},
          {"text", plate.text},
          {"confidence", std::round(plate.confidence * 1e4) / 1e4},
          {"country", plate.country.empty() ? nlohmann::ordered_json()
                                            : nlohmann::ordered_json(plate.country)},
          {"source", plate.source},
          {"first_time", moment_text(plate.first_time)},
          {"last_time", moment_text(plate.last_time)},
          {"frames", plate.frames},
          {"box", {plate.box.x, plate.box.y, plate.box.width, plate.box.height}},
          {"candidates", list_of(plate.candidates, what + "candidates", path)},
          {"readings", list_of(plate.readings, what + "readings", path)},
          {"crop", plate.has_crop}};
}

std::string logged_csv_header() {
  return csv_line({"id", "first_time", "last_time", "source", "text", "confidence", "country",
                   "frames", "x", "y", "w", "h"});
}

std::string logged_csv_line(const LoggedPlate& plate) {
  return csv_line({fmt::format("{}", plate.id), moment_text(plate.first_time),
                   moment_text(plate.last_time), plate.source, plate.text,
                   fmt::format("{:.4f}", plate.confidence), plate.country,
                   fmt::format("{}", plate.frames), fmt::format("{}", plate.box.x),
                   fmt::format("{}", plate.box.y), fmt::format("{}", plate.box.width),
                   fmt::format("{}", plate.box.height)});
}

}  // namespace tarsier::plate
