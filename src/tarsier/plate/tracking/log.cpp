// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/log.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/image_file.h"
#include "tarsier/plate/text/text.h"
#include "tarsier/plate/tracking/crop_bytes.h"
#include "tarsier/plate/tracking/source_clock.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>
#include <limits>
#include <nlohmann/json.hpp>

namespace tarsier::plate {
namespace {

constexpr int kCropQuality = 90;
constexpr std::size_t kMaxSource = 1000;  // bytes

// 'TPL1'. New columns would be stored after the images, so reading them would mean reading the
// images. Data of a few entries therefore has its own table. plate_gram: the trigrams of each
// folded text with an end mark ('1234BCD' has 123, 234, 34B, 4BC, BC0, C0$). Two characters are
// entries as the beginning of a trigram. The SQL must cut texts like trigrams_of().
const DatabaseKind kKind{"Tarsier plate log",
                         0x54504C31,
                         {R"sql(
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
)sql",
                          R"sql(
CREATE TABLE plate_run(
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  process TEXT NOT NULL         -- that writes open entries
) STRICT;
CREATE TABLE plate_mark(
  plate INTEGER PRIMARY KEY,    -- entries without a mark are closed, their times right
  run INTEGER NOT NULL,
  open INTEGER NOT NULL,        -- 0 closed, 1 open, 2 interrupted
  unsynced INTEGER NOT NULL,    -- 1: written while the clock was not synchronized
  retain_from INTEGER           -- of these: when forgetting first saw it, ms
) STRICT;
CREATE INDEX plate_mark_by_run ON plate_mark(run, plate);
CREATE INDEX plate_by_text ON plate(text, last_time);
CREATE TABLE plate_gram(
  gram TEXT NOT NULL,
  plate INTEGER NOT NULL,
  PRIMARY KEY(gram, plate)
) STRICT, WITHOUT ROWID;
WITH RECURSIVE piece(plate, t, n) AS (
  SELECT id, replace(replace(replace(replace(substr(text, 1, 64), 'O', '0'), 'Q', '0'), 'D', '0'),
                     'I', '1') || '$', 1 FROM plate
  UNION ALL SELECT plate, t, n + 1 FROM piece WHERE n < length(t) - 2)
INSERT OR IGNORE INTO plate_gram
  SELECT substr(t, n, 3) AS gram, plate FROM piece ORDER BY gram, plate;
)sql",
                          R"sql(
CREATE TABLE plate_correction(
  id INTEGER PRIMARY KEY AUTOINCREMENT,  -- of one plate the last counts
  plate INTEGER NOT NULL,
  text TEXT NOT NULL,           -- its pieces are in plate_gram as well
  author TEXT NOT NULL,
  time INTEGER NOT NULL         -- ms since 1970-01-01, UTC
) STRICT;
CREATE INDEX plate_correction_by_plate ON plate_correction(plate, id);
CREATE INDEX plate_correction_by_text ON plate_correction(text);
)sql"},
                         1};

// Condition for the rows `c` of plate_correction that are in effect.
constexpr const char* kLastCorrection =
    "c.id = (SELECT max(id) FROM plate_correction WHERE plate = c.plate)";

std::int64_t number_of(Moment moment) { return moment.time_since_epoch().count(); }

// Limited to the years 1970 to 9999, whatever the file contains.
Moment moment_of(std::int64_t number) {
  constexpr std::int64_t kEnd = 253'402'300'799'999;
  return Moment(std::chrono::milliseconds(std::clamp<std::int64_t>(number, 0, kEnd)));
}

std::string prefix_end(std::string text) {  // upper bound of all texts with this prefix
  ++text.back();
  return text;
}

int to_int(std::int64_t number) {
  return static_cast<int>(std::clamp<std::int64_t>(number, std::numeric_limits<int>::min(),
                                                   std::numeric_limits<int>::max()));
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
  plate.box = {to_int(row.integer(8)), to_int(row.integer(9)), to_int(row.integer(10)),
               to_int(row.integer(11))};
  plate.candidates = row.text(12);
  plate.readings = row.text(13);
  plate.has_crop = row.integer(14) != 0;
  const std::int64_t open = row.integer(15);
  plate.state = open == 0   ? LoggedPlate::State::kClosed
                : open == 1 ? LoggedPlate::State::kOpen
                            : LoggedPlate::State::kInterrupted;
  plate.synchronized = row.integer(16) == 0;
  if (!row.is_null(17)) plate.correction = {row.text(17), row.text(18), moment_of(row.integer(19))};
  return plate;
}

std::string json_text(const nlohmann::ordered_json& value) {
  return value.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

// All reads until the end see the same snapshot.
class ReadTransaction {
 public:
  explicit ReadTransaction(Database& database) : database_(database) { database_.run("BEGIN"); }
  ~ReadTransaction() {
    try {
      database_.run("ROLLBACK");
    } catch (const Error&) {
      // The transaction has ended by an error.
    }
  }
  ReadTransaction(const ReadTransaction&) = delete;
  ReadTransaction& operator=(const ReadTransaction&) = delete;

 private:
  Database& database_;
};

// Frees pages in steps; then truncates the write-ahead log, which holds the old pages, unless
// another process is reading it.
void reclaim_space(Database& database, std::int64_t deleted, const ForgetOptions& options) {
  constexpr std::int64_t kPagesPerStep = 2000;
  std::int64_t free_before = std::numeric_limits<std::int64_t>::max();
  while (true) {
    std::int64_t free = 0;
    {
      Statement pages(database, "PRAGMA freelist_count");
      if (pages.step()) free = pages.integer(0);
    }
    if (free == 0 || free >= free_before) break;  // or nothing can be freed
    free_before = free;
    database.run(fmt::format("PRAGMA incremental_vacuum({})", kPagesPerStep));
    if (options.after_batch) options.after_batch(deleted);
  }
  // The checkpoint blocks other writers while it waits for readers: keep that short.
  database.set_lock_timeout(100);
  database.run("PRAGMA wal_checkpoint(TRUNCATE)");
}

}  // namespace

std::vector<std::uint8_t> crop_bytes(const PlateEvent& event, const std::string& path) {
  return encode_image(".jpg", event.best_crop, path, kCropQuality);
}

PlateLog::PlateLog(const std::string& path, DatabaseAccess access, int lock_timeout_ms)
    : database_(path, kKind, access, lock_timeout_ms),
      indexed_(database_.version() >= 2),
      corrected_(database_.version() >= 3) {}

std::int64_t PlateLog::append(const PlateEvent& event) {
  std::vector<std::uint8_t> crop;
  if (!event.best_crop.empty()) crop = crop_bytes(event, database_.path());
  Transaction together(database_);
  const std::int64_t id = put(event, 0, 0, std::span<const std::uint8_t>(crop));
  together.commit();
  return id;
}

std::int64_t PlateLog::begin_run(const std::string& process,
                                 const std::function<bool(const std::string&)>& is_alive) {
  Transaction together(database_);
  std::vector<std::int64_t> dead;
  {
    Statement runs(database_, "SELECT id, process FROM plate_run");
    while (runs.step()) {
      if (!is_alive(runs.text(1))) dead.push_back(runs.integer(0));
    }
  }
  for (const std::int64_t run : dead) {
    Statement(database_, "UPDATE plate_mark SET open = 2 WHERE run = ? AND open = 1")
        .bind(1, run)
        .step();
    Statement(database_, "DELETE FROM plate_run WHERE id = ?").bind(1, run).step();
  }
  Statement(database_, "INSERT INTO plate_run(process) VALUES(?)")
      .bind(1, std::string_view(process))
      .step();
  const std::int64_t run = database_.last_row_id();
  together.commit();
  return run;
}

void PlateLog::end_run(std::int64_t run) {
  Statement(database_, "DELETE FROM plate_run WHERE id = ?").bind(1, run).step();
}

std::int64_t PlateLog::put(const PlateEvent& event, std::int64_t id, std::int64_t run,
                           std::optional<std::span<const std::uint8_t>> crop) {
  const std::string source = masked(event.source);
  std::optional<std::string> before;
  if (id > 0) {
    Statement row(database_, "SELECT text FROM plate WHERE id = ?");
    if (row.bind(1, id).step()) before = row.text(0);
  }
  Statement write(database_,
                  before ? "UPDATE plate SET first_time = ?, last_time = ?, source = ?, text = ?, "
                           "confidence = ?, country = ?, frames = ?, x = ?, y = ?, w = ?, h = ?, "
                           "candidates = ?, readings = ? WHERE id = ?"
                         : "INSERT INTO plate(first_time, last_time, source, text, confidence, "
                           "country, frames, x, y, w, h, candidates, readings) "
                           "VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  write.bind(1, number_of(event.first_seen))
      .bind(2, number_of(event.last_seen))
      .bind(3, std::string_view(source).substr(0, kMaxSource))
      .bind(4, std::string_view(event.text))
      .bind(5, std::isfinite(event.confidence) ? event.confidence : 0.0)
      .bind(6, std::string_view(event.country))
      .bind(7, event.frames)
      .bind(8, std::int64_t{event.best_box.x})
      .bind(9, std::int64_t{event.best_box.y})
      .bind(10, std::int64_t{event.best_box.width})
      .bind(11, std::int64_t{event.best_box.height})
      .bind(12, std::string_view(json_text(candidates_json(event.candidates))))
      .bind(13, std::string_view(json_text(readings_json(event.readings))));
  if (before) write.bind(14, id);
  (void)write.step();
  if (!before) id = database_.last_row_id();
  if (crop && !crop->empty()) {
    Statement(database_, "UPDATE plate SET crop = ? WHERE id = ?")
        .bind(1, *crop)
        .bind(2, id)
        .step();
  }
  if (!before || *before != event.text) {
    if (before) remove_grams(id, *before);
    add_grams(id, event.text);
    if (before) {
      if (const auto corrected = correction_of(id)) add_grams(id, *corrected);
    }
  }
  mark(event, id, run);
  return id;
}

void PlateLog::mark(const PlateEvent& event, std::int64_t id, std::int64_t run) {
  const bool open = event.state == PlateState::kOpened || event.state == PlateState::kUpdated;
  if (!open && event.synchronized) {
    Statement(database_, "DELETE FROM plate_mark WHERE plate = ?").bind(1, id).step();
    return;
  }
  Statement(database_,
            "INSERT INTO plate_mark(plate, run, open, unsynced) VALUES(?, ?, ?, ?) ON "
            "CONFLICT(plate) DO UPDATE SET run = excluded.run, open = excluded.open, unsynced = "
            "excluded.unsynced")
      .bind(1, id)
      .bind(2, run)
      .bind(3, std::int64_t{open ? 1 : 0})
      .bind(4, std::int64_t{event.synchronized ? 0 : 1})
      .step();
}

void PlateLog::add_grams(std::int64_t id, const std::string& text) {
  Statement add(database_, "INSERT OR IGNORE INTO plate_gram VALUES(?, ?)");
  for (const std::string& gram : trigrams_of(text)) {
    add.bind(1, std::string_view(gram)).bind(2, id).step();
    add.reset();
  }
}

void PlateLog::remove_grams(std::int64_t id, const std::string& text) {
  Statement remove(database_, "DELETE FROM plate_gram WHERE gram = ? AND plate = ?");
  for (const std::string& gram : trigrams_of(text)) {
    remove.bind(1, std::string_view(gram)).bind(2, id).step();
    remove.reset();
  }
}

void PlateLog::remove(std::int64_t id) {
  std::string text;
  {
    Statement row(database_, "SELECT text FROM plate WHERE id = ?");
    if (!row.bind(1, id).step()) return;
    text = row.text(0);
  }
  remove_grams(id, text);
  if (const auto corrected = correction_of(id)) {
    remove_grams(id, *corrected);
    Statement(database_, "DELETE FROM plate_correction WHERE plate = ?").bind(1, id).step();
  }
  Statement(database_, "DELETE FROM plate_mark WHERE plate = ?").bind(1, id).step();
  Statement(database_, "DELETE FROM plate WHERE id = ?").bind(1, id).step();
}

std::string PlateLog::text_of(std::int64_t id) {
  Statement row(database_, "SELECT text FROM plate WHERE id = ?");
  if (!row.bind(1, id).step())
    throw MissingEntryError(database_.path(), "plate", fmt::format("has no entry {}", id));
  return row.text(0);
}

std::optional<std::string> PlateLog::correction_of(std::int64_t id) {
  Statement row(database_,
                "SELECT text FROM plate_correction WHERE plate = ? ORDER BY id DESC LIMIT 1");
  if (!row.bind(1, id).step()) return std::nullopt;
  return row.text(0);
}

void PlateLog::correct(std::int64_t id, const PlateCorrection& correction) {
  const bool is_plate = std::all_of(correction.text.begin(), correction.text.end(),
                                    [](char c) { return class_of(c) >= 0; });
  TARSIER_REQUIRE(is_plate && !correction.text.empty() && correction.text.size() <= kMaxText,
                  "the text '{}'", printable(correction.text));
  TARSIER_REQUIRE(
      correction.author.size() <= 200 && correction.author.find('\n') == std::string::npos,
      "an author of {} bytes", correction.author.size());
  Transaction together(database_);
  const std::string text = text_of(id);
  if (const auto before = correction_of(id)) remove_grams(id, *before);
  Statement(database_, "INSERT INTO plate_correction(plate, text, author, time) VALUES(?, ?, ?, ?)")
      .bind(1, id)
      .bind(2, std::string_view(correction.text))
      .bind(3, std::string_view(correction.author))
      .bind(4, number_of(correction.time))
      .step();
  add_grams(id, text);
  add_grams(id, correction.text);
  together.commit();
}

bool PlateLog::undo_correction(std::int64_t id) {
  Transaction together(database_);
  const std::string text = text_of(id);
  const auto last = correction_of(id);
  if (!last) return false;
  remove_grams(id, *last);
  Statement(database_,
            "DELETE FROM plate_correction WHERE id = (SELECT max(id) FROM plate_correction WHERE "
            "plate = ?)")
      .bind(1, id)
      .step();
  add_grams(id, text);
  if (const auto before = correction_of(id)) add_grams(id, *before);
  together.commit();
  return true;
}

void PlateLog::shift_unsynchronized(std::int64_t run, std::chrono::milliseconds by) {
  Statement(database_,
            "UPDATE plate SET first_time = first_time + ?1, last_time = last_time + ?1 WHERE id IN "
            "(SELECT plate FROM plate_mark WHERE run = ?2 AND unsynced = 1)")
      .bind(1, std::int64_t{by.count()})
      .bind(2, run)
      .step();
}

void PlateLog::trust_clock(std::int64_t run) {
  Statement(database_, "DELETE FROM plate_mark WHERE run = ? AND open = 0").bind(1, run).step();
  Statement(database_, "UPDATE plate_mark SET unsynced = 0 WHERE run = ?").bind(1, run).step();
}

// Uses an index where the pattern allows: for equal texts, a prefix, or required pieces. Otherwise
// it scans the index of all texts. The results are then matched exactly.
std::vector<PlateLog::Match> PlateLog::find_matches(const LogFilter& filter) {
  const std::string& pattern = filter.text;
  std::vector<Match> entries;
  const auto collect = [&](Statement& rows) {  // id, text, last_time
    std::string last;
    bool is_match = false;
    bool first = true;
    while (rows.step()) {
      std::string text = rows.text(1);
      if (first || text != last) {  // equal texts are adjacent in the index
        is_match = matches(pattern, text, filter.near);
        last = std::move(text);
        first = false;
      }
      if (is_match) entries.push_back({rows.integer(2), rows.integer(0)});
    }
  };
  // Searches both the original and the corrected texts; `column` is the column of the text, `id`
  // that of the plate.
  const auto search = [&](const std::string& condition, const std::string& order,
                          const std::function<void(Statement&)>& bind) {
    const auto substituted = [&](std::string text, const std::string& column,
                                 const std::string& id) {
      for (const auto& [name, value] : {std::pair{"{text}", column}, std::pair{"{id}", id}}) {
        for (std::size_t at = text.find(name); at != std::string::npos; at = text.find(name))
          text.replace(at, std::string_view(name).size(), value);
      }
      return text;
    };
    {
      Statement rows(database_, "SELECT id, text, last_time FROM plate" +
                                    substituted(condition, "text", "id") +
                                    substituted(order, "text", "id"));
      bind(rows);
      collect(rows);
    }
    if (!corrected_) return;
    Statement rows(database_,
                   "SELECT p.id, c.text, p.last_time FROM plate_correction c JOIN plate p ON p.id "
                   "= c.plate" +
                       substituted(condition, "c.text", "c.plate") +
                       (condition.empty() ? " WHERE " : " AND ") + kLastCorrection +
                       substituted(order, "c.text", "c.plate"));
    bind(rows);
    collect(rows);
  };
  const std::string begin = pattern.substr(0, pattern.find_first_of("*?"));
  if (!filter.near && begin.size() == pattern.size()) {
    search(" WHERE {text} = ?1", "",
           [&](Statement& rows) { rows.bind(1, std::string_view(pattern)); });
    return entries;
  }
  const std::vector<std::string> pieces =
      filter.near ? near_match_pieces(pattern) : required_pieces(pattern);
  const bool has_piece =
      indexed_ && !pieces.empty() && (filter.near || pieces[0].size() > begin.size());
  if (has_piece) {
    // With `near`, one of two pieces must be present. Otherwise all must; three are selective
    // enough.
    std::string query;
    const std::size_t count = std::min<std::size_t>(pieces.size(), 3);
    for (std::size_t k = 0; k < count; ++k) {
      if (k > 0 && !filter.near && pieces[k].size() < kGramSize) break;
      if (k > 0) query += filter.near ? " UNION " : " INTERSECT ";
      query += pieces[k].size() >= kGramSize
                   ? fmt::format("SELECT plate FROM plate_gram WHERE gram = ?{}", 2 * k + 1)
                   : fmt::format("SELECT plate FROM plate_gram WHERE gram >= ?{} AND gram < ?{}",
                                 2 * k + 1, 2 * k + 2);
    }
    search(" WHERE {id} IN (" + query + ")", "", [&](Statement& rows) {
      for (std::size_t k = 0; k < count; ++k) {
        if (k > 0 && !filter.near && pieces[k].size() < kGramSize) break;
        rows.bind(static_cast<int>(2 * k + 1), std::string_view(pieces[k]));
        if (pieces[k].size() < kGramSize)
          rows.bind(static_cast<int>(2 * k + 2), std::string_view(prefix_end(pieces[k])));
      }
    });
    return entries;
  }
  if (!filter.near && !begin.empty()) {
    search(" WHERE {text} >= ?1 AND {text} < ?2", "", [&](Statement& rows) {
      rows.bind(1, std::string_view(begin)).bind(2, std::string_view(prefix_end(begin)));
    });
    return entries;
  }
  search("", " ORDER BY {text}", [](Statement&) {});
  return entries;
}

std::string PlateLog::columns() const {
  return fmt::format(
      "SELECT plate.id, first_time, last_time, source, plate.text, confidence, country, frames, x, "
      "y, w, h, candidates, readings, crop IS NOT NULL, {}, {} FROM plate {} {} ",
      indexed_ ? "coalesce(open, 0), coalesce(unsynced, 0)" : "0, 0",
      corrected_ ? "c.text, c.author, c.time" : "NULL, NULL, NULL",
      indexed_ ? "LEFT JOIN plate_mark ON plate_mark.plate = plate.id" : "",
      corrected_ ? "LEFT JOIN plate_correction c ON c.id = (SELECT max(id) FROM plate_correction "
                   "WHERE plate = plate.id)"
                 : "");
}

std::optional<LoggedPlate> PlateLog::entry(std::int64_t id) {
  Statement row(database_, columns() + "WHERE plate.id = ?");
  if (!row.bind(1, id).step()) return std::nullopt;
  return plate_at(row);
}

std::int64_t PlateLog::query(const LogFilter& filter,
                             const std::function<bool(const LoggedPlate&)>& take) {
  constexpr std::int64_t kMaxTime = std::numeric_limits<std::int64_t>::max();
  const std::int64_t since = filter.since ? number_of(*filter.since) : -kMaxTime;
  const std::int64_t until = filter.until ? number_of(*filter.until) : kMaxTime;
  const std::string selected = columns();
  const std::string condition =
      "last_time >= ?1 AND first_time <= ?2 AND (?3 = '' OR source = ?3) ";
  const auto bind = [&](Statement& rows) {
    rows.bind(1, since).bind(2, until).bind(3, std::string_view(filter.source));
  };
  std::int64_t entry_count = 0;
  const auto is_enough = [&] { return filter.limit > 0 && entry_count >= filter.limit; };
  if (filter.text.empty()) {
    Statement rows(database_,
                   selected + "WHERE " + condition + "ORDER BY last_time DESC, plate.id DESC");
    bind(rows);
    while (!is_enough() && rows.step()) {
      ++entry_count;
      if (!take(plate_at(rows))) break;
    }
    return entry_count;
  }
  const ReadTransaction moment(database_);  // the entries must be those found above
  std::vector<Match> entries = find_matches(filter);
  std::erase_if(entries, [&](const Match& entry) { return entry.last_time < since; });
  std::sort(entries.begin(), entries.end(), [](const Match& a, const Match& b) {
    return a.last_time != b.last_time ? a.last_time > b.last_time : a.id > b.id;
  });
  // Both texts of an entry may match.
  entries.erase(std::unique(entries.begin(), entries.end(),
                            [](const Match& a, const Match& b) { return a.id == b.id; }),
                entries.end());
  Statement row(database_, selected + "WHERE plate.id = ?4 AND " + condition);
  for (const Match& entry : entries) {
    if (is_enough()) break;
    bind(row);
    row.bind(4, entry.id);
    std::optional<LoggedPlate> plate;
    if (row.step()) plate = plate_at(row);
    row.reset();
    if (!plate) continue;
    ++entry_count;
    if (!take(*plate)) break;
  }
  return entry_count;
}

std::vector<std::uint8_t> PlateLog::crop(std::int64_t id) {
  Statement row(database_, "SELECT crop FROM plate WHERE id = ?");
  row.bind(1, id);
  return row.step() ? row.bytes(0) : std::vector<std::uint8_t>();
}

PlateHistory PlateLog::history(const std::string& text, Moment moment) {
  const std::string query =
      corrected_
          ? fmt::format(
                "SELECT count(*), min(first_time), max(last_time) FROM plate WHERE "
                "last_time < ?2 AND id IN (SELECT id FROM plate p WHERE p.text = ?1 AND "
                "NOT EXISTS (SELECT 1 FROM plate_correction c WHERE c.plate = p.id AND "
                "c.text <> ?1 AND {0}) UNION SELECT c.plate FROM plate_correction c WHERE "
                "c.text = ?1 AND {0})",
                kLastCorrection)
          : "SELECT count(*), min(first_time), max(last_time) FROM plate WHERE text = ?1 AND "
            "last_time < ?2";
  Statement row(database_, query);
  row.bind(1, std::string_view(text)).bind(2, number_of(moment));
  PlateHistory history;
  if (!row.step() || row.integer(0) == 0) return history;
  history.visits = row.integer(0);
  history.first_time = moment_of(row.integer(1));
  history.last_time = moment_of(row.integer(2));
  return history;
}

std::int64_t PlateLog::forget(Moment now, std::chrono::milliseconds age,
                              const ForgetOptions& options) {
  options.check();
  if (!is_plausible(now)) {
    throw InputError(
        database_.path(),
        fmt::format("nothing is deleted, as the clock says {}: set it first", moment_text(now)));
  }
  const std::int64_t cutoff = number_of(now - age);
  struct OldEntry {
    std::int64_t id = 0;
    std::int64_t last_time = 0;
    std::string text;
    bool is_certain = true;
    bool is_unmarked = false;
  };
  std::int64_t deleted = 0;
  std::int64_t from_time = std::numeric_limits<std::int64_t>::min();
  std::int64_t from_id = from_time;
  while (true) {
    Transaction together(database_);
    std::vector<OldEntry> batch;
    {
      Statement rows(
          database_,
          "SELECT p.id, p.last_time, p.text, coalesce(m.unsynced, 0), m.retain_from, "
          "(SELECT n.last_time FROM plate n WHERE n.id = (SELECT max(k.plate) FROM plate_mark k "
          "WHERE k.run = m.run)) FROM plate p LEFT JOIN plate_mark m ON m.plate = p.id WHERE "
          "(p.last_time, p.id) > (?1, ?2) AND p.last_time < ?3 ORDER BY p.last_time, p.id LIMIT "
          "?4");
      rows.bind(1, from_time).bind(2, from_id).bind(3, cutoff).bind(4, std::int64_t{options.batch});
      while (rows.step()) {
        OldEntry entry{rows.integer(0), rows.integer(1), rows.text(2)};
        if (rows.integer(3) != 0) {
          const bool seen_long_ago = !rows.is_null(4) && rows.integer(4) < cutoff;
          const bool long_before_others =
              !rows.is_null(5) && rows.integer(5) - entry.last_time > age.count();
          entry.is_certain = seen_long_ago || long_before_others;
          entry.is_unmarked = rows.is_null(4);
        }
        batch.push_back(std::move(entry));
      }
    }
    if (batch.empty()) break;
    from_time = batch.back().last_time;
    from_id = batch.back().id;
    const std::int64_t before = deleted;
    for (const OldEntry& entry : batch) {
      if (entry.is_certain) {
        remove(entry.id);
        ++deleted;
      } else if (entry.is_unmarked) {
        Statement(database_, "UPDATE plate_mark SET retain_from = ? WHERE plate = ?")
            .bind(1, number_of(now))
            .bind(2, entry.id)
            .step();
      }
    }
    together.commit();
    if (options.after_batch && deleted > before) options.after_batch(deleted);
    if (batch.size() < static_cast<std::size_t>(options.batch)) break;
  }
  if (deleted > 0) reclaim_space(database_, deleted, options);
  return deleted;
}

}  // namespace tarsier::plate
