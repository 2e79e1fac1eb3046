// SPDX-License-Identifier: MIT
#include "tarsier/gallery/gallery.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/gallery/name.h"
#include "tarsier/io/frame_source.h"
#include "tarsier/io/image_file.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <utility>

namespace tarsier::people {
namespace {

constexpr std::size_t kMostSource = 1000;       // bytes
constexpr std::size_t kMostTemplate = 200'000;  // numbers

// 'TPG1'
const DatabaseKind kKind{"Tarsier people gallery", 0x54504731, {R"sql(
CREATE TABLE person(
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  name TEXT NOT NULL UNIQUE,
  note TEXT NOT NULL,
  time INTEGER NOT NULL         -- ms since 1970-01-01, UTC
) STRICT;
CREATE TABLE face(
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  person INTEGER NOT NULL REFERENCES person(id) ON DELETE CASCADE,
  crop BLOB NOT NULL,           -- PNG
  template BLOB,                -- float32, little-endian
  quality REAL NOT NULL,
  measures TEXT NOT NULL,       -- JSON
  source TEXT NOT NULL,
  time INTEGER NOT NULL
) STRICT;
CREATE INDEX face_by_person ON face(person);
CREATE TABLE model(
  id INTEGER PRIMARY KEY CHECK(id = 1),
  generation INTEGER NOT NULL,
  body BLOB NOT NULL
) STRICT;
CREATE TABLE setting(name TEXT PRIMARY KEY, value TEXT NOT NULL) STRICT;
CREATE TABLE sighting(
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  time INTEGER NOT NULL,
  source TEXT NOT NULL,
  person INTEGER NOT NULL REFERENCES person(id) ON DELETE CASCADE,
  known INTEGER NOT NULL,
  confidence REAL NOT NULL
) STRICT;
CREATE INDEX sighting_by_time ON sighting(time);
CREATE INDEX sighting_by_person ON sighting(person);
)sql"}};

std::span<const std::uint8_t> bytes_of(const std::vector<float>& numbers) {
  return {reinterpret_cast<const std::uint8_t*>(numbers.data()), numbers.size() * sizeof(float)};
}

std::vector<float> numbers_of(const std::vector<std::uint8_t>& bytes, const std::string& path,
                              std::int64_t id) {
  if (bytes.size() % sizeof(float) != 0 || bytes.size() > kMostTemplate * sizeof(float))
    throw InputError(path, fmt::format("face {}: its template is damaged", id));
  std::vector<float> numbers(bytes.size() / sizeof(float));
  if (!bytes.empty()) std::memcpy(numbers.data(), bytes.data(), bytes.size());
  for (const float number : numbers)
    if (!std::isfinite(number))
      throw InputError(path, fmt::format("face {}: its template is damaged", id));
  return numbers;
}

Person person_at(const Statement& row, const std::string& path) {
  Person person{row.integer(0), row.text(1), row.text(2), row.integer(3), row.integer(4)};
  try {
    check_name(person.name);
  } catch (const UsageError& error) {
    throw InputError(path, error.what());
  }
  return person;
}

cv::Mat crop_of(const std::vector<std::uint8_t>& png, const std::string& path, std::int64_t id) {
  ImageLimits limits;
  limits.max_pixels = 4'000'000;
  const cv::Mat color = decode_image(png, fmt::format("{}: face {}", path, id), limits);
  cv::Mat gray;
  cv::cvtColor(color, gray, cv::COLOR_BGR2GRAY);
  return gray;
}

std::string folder_of(const std::string& path) {
  return std::filesystem::path(path).parent_path().string();
}

// All that a PNG of this size has in common with others: signature, header, the data chunk's head.
constexpr std::size_t kPngHead = 43;

void each_secret(Database& database, const char* condition, std::int64_t person,
                 const std::function<void(std::span<const std::uint8_t>)>& take) {
  Statement rows(database,
                 fmt::format("SELECT crop, template FROM face WHERE person {} ?", condition));
  rows.bind(1, person);
  while (rows.step()) {
    const std::vector<std::uint8_t> crop = rows.bytes(0);
    const std::vector<std::uint8_t> features = rows.bytes(1);
    if (crop.size() > kPngHead) take(std::span(crop).subspan(kPngHead));
    take(features);
  }
}

}  // namespace

Gallery::Gallery(const std::string& path, DatabaseAccess access, int patience_ms)
    : database_(path, kKind, access, patience_ms) {}

std::vector<Person> Gallery::people() {
  Statement rows(database_,
                 "SELECT id, name, note, time, (SELECT count(*) FROM face WHERE person = person.id)"
                 " FROM person ORDER BY id");
  std::vector<Person> out;
  while (rows.step()) out.push_back(person_at(rows, path()));
  return out;
}

std::optional<Person> Gallery::find(std::string_view name) {
  Statement row(database_,
                "SELECT id, name, note, time, (SELECT count(*) FROM face WHERE person = person.id)"
                " FROM person WHERE name = ?");
  row.bind(1, name);
  if (!row.step()) return std::nullopt;
  return person_at(row, path());
}

Person Gallery::add_person(std::string_view name, std::string_view note, std::int64_t time) {
  check_name(name);
  check_note(note);
  const bool known = find(name).has_value();
  if (known && note.empty()) return *find(name);
  {
    Statement statement(database_, known
                                       ? "UPDATE person SET note = ?1 WHERE name = ?2"
                                       : "INSERT INTO person(note, name, time) VALUES(?1, ?2, ?3)");
    statement.bind(1, note).bind(2, name);
    if (!known) statement.bind(3, time);
    (void)statement.step();
  }
  changed();
  return *find(name);
}

std::int64_t Gallery::add_face(const StoredFace& face) {
  require_gray(face.crop);
  TARSIER_REQUIRE(std::isfinite(face.quality), "quality {}", face.quality);
  const std::vector<std::uint8_t> png = encode_image(".png", face.crop, path());
  const std::string shown = masked(face.source);
  Statement insert(database_,
                   "INSERT INTO face(person, crop, template, quality, measures, source, time) "
                   "VALUES(?, ?, ?, ?, ?, ?, ?)");
  insert.bind(1, face.person).bind(2, std::span<const std::uint8_t>(png));
  if (face.features.empty()) {
    insert.bind_null(3);
  } else {
    insert.bind(3, bytes_of(face.features));
  }
  insert.bind(4, face.quality)
      .bind(5, std::string_view(face.measures))
      .bind(6, std::string_view(shown).substr(0, kMostSource))
      .bind(7, face.time);
  (void)insert.step();
  const std::int64_t id = database_.last_row_id();
  changed();
  return id;
}

std::int64_t Gallery::enroll(std::string_view name, std::string_view note, const StoredFace& face) {
  Transaction transaction(database_);
  StoredFace filled = face;
  filled.person = add_person(name, note, face.time).id;
  const std::int64_t id = add_face(filled);
  transaction.commit();
  return id;
}

std::vector<StoredFace> Gallery::faces(std::optional<std::int64_t> person, bool crops) {
  Statement rows(database_, fmt::format("SELECT id, person, {}, template, quality, measures, "
                                        "source, time FROM face WHERE ? < 0 OR person = ? "
                                        "ORDER BY id",
                                        crops ? "crop" : "NULL"));
  rows.bind(1, person.value_or(-1)).bind(2, person.value_or(-1));
  std::vector<StoredFace> out;
  while (rows.step()) {
    StoredFace face;
    face.id = rows.integer(0);
    face.person = rows.integer(1);
    if (crops) face.crop = crop_of(rows.bytes(2), path(), face.id);
    face.features = numbers_of(rows.bytes(3), path(), face.id);
    face.quality = rows.real(4);
    face.measures = rows.text(5);
    face.source = rows.text(6);
    face.time = rows.integer(7);
    out.push_back(std::move(face));
  }
  return out;
}

std::int64_t Gallery::face_count() {
  Statement row(database_, "SELECT count(*) FROM face");
  return row.step() ? row.integer(0) : 0;
}

std::optional<StoredFace> Gallery::latest_face(std::int64_t person) {
  Statement row(database_,
                "SELECT id, crop, quality, time FROM face WHERE person = ? "
                "ORDER BY id DESC LIMIT 1");
  row.bind(1, person);
  if (!row.step()) return std::nullopt;
  StoredFace face;
  face.id = row.integer(0);
  face.person = person;
  face.crop = crop_of(row.bytes(1), path(), face.id);
  face.quality = row.real(2);
  face.time = row.integer(3);
  return face;
}

std::optional<ForgetReport> Gallery::forget(std::string_view name, const std::stop_token& stop) {
  const std::optional<Person> person = find(name);
  if (!person) return std::nullopt;
  ForgetReport report;
  report.person = *person;
  Pieces pieces;
  each_secret(database_, "=", person->id,
              [&](std::span<const std::uint8_t> bytes) { pieces.add(bytes); });
  each_secret(database_, "<>", person->id,
              [&](std::span<const std::uint8_t> bytes) { pieces.keep(bytes); });
  {
    Transaction transaction(database_);
    {
      Statement count(database_, "SELECT count(*) FROM sighting WHERE person = ?");
      count.bind(1, person->id);
      if (count.step()) report.sightings = count.integer(0);
    }
    for (const char* statement :
         {"DELETE FROM sighting WHERE person = ?", "DELETE FROM face WHERE person = ?",
          "DELETE FROM person WHERE id = ?"}) {
      Statement remove(database_, statement);
      remove.bind(1, person->id);
      (void)remove.step();
    }
    changed();
    transaction.commit();
  }
  report.log_emptied = give_back_room();
  report.search = search_folder(pieces, folder_of(path()), stop);
  return report;
}

std::int64_t Gallery::generation() {
  Statement row(database_, "SELECT value FROM setting WHERE name = 'generation'");
  return row.step() ? row.integer(0) : 0;
}

// What was learned depends on every face that was there: it is not kept beyond them.
void Gallery::changed() {
  database_.run(
      "INSERT INTO setting(name, value) VALUES('generation', '1') ON CONFLICT(name) DO UPDATE SET "
      "value = CAST(CAST(value AS INTEGER) + 1 AS TEXT);"
      "DELETE FROM model; UPDATE face SET template = NULL WHERE template IS NOT NULL");
}

// Returns whether the write-ahead log is empty now.
bool Gallery::give_back_room() {
  database_.vacuum();
  Statement checkpoint(database_, "PRAGMA wal_checkpoint(TRUNCATE)");
  return checkpoint.step() && checkpoint.integer(0) == 0;
}

void Gallery::store_model(
    std::string_view body, std::int64_t generation,
    const std::vector<std::pair<std::int64_t, std::vector<float>>>& templates) {
  Transaction transaction(database_);
  if (this->generation() != generation) return;  // another program enrolled meanwhile
  {
    Statement insert(database_,
                     "INSERT OR REPLACE INTO model(id, generation, body) VALUES(1, ?, ?)");
    insert.bind(1, generation)
        .bind(2, std::span(reinterpret_cast<const std::uint8_t*>(body.data()), body.size()));
    (void)insert.step();
  }
  for (const auto& [id, values] : templates) {
    Statement update(database_, "UPDATE face SET template = ? WHERE id = ?");
    update.bind(1, bytes_of(values)).bind(2, id);
    (void)update.step();
  }
  transaction.commit();
}

std::optional<std::string> Gallery::model() {
  Statement row(database_, "SELECT body FROM model WHERE generation = ?");
  row.bind(1, generation());
  if (!row.step()) return std::nullopt;
  const std::vector<std::uint8_t> bytes = row.bytes(0);
  return std::string(bytes.begin(), bytes.end());
}

std::string Gallery::algorithm() {
  Statement row(database_, "SELECT value FROM setting WHERE name = 'algorithm'");
  return row.step() ? row.text(0) : "default";
}

void Gallery::set_algorithm(std::string_view name) {
  if (algorithm() == name) return;
  Transaction transaction(database_);
  {
    Statement insert(database_,
                     "INSERT OR REPLACE INTO setting(name, value) VALUES('algorithm', ?)");
    insert.bind(1, name);
    (void)insert.step();
  }
  changed();
  transaction.commit();
}

void Gallery::add_sighting(std::int64_t time, std::string_view source, std::string_view name,
                           bool known, double confidence) {
  const std::string shown = masked(source);
  Statement insert(database_,
                   "INSERT INTO sighting(time, source, person, known, confidence) "
                   "SELECT ?, ?, id, ?, ? FROM person WHERE name = ?");
  insert.bind(1, time)
      .bind(2, std::string_view(shown).substr(0, kMostSource))
      .bind(3, std::int64_t{known ? 1 : 0})
      .bind(4, std::isfinite(confidence) ? confidence : 0.0)
      .bind(5, name);
  (void)insert.step();
}

std::vector<Sighting> Gallery::sightings(std::int64_t limit) {
  Statement rows(database_,
                 "SELECT sighting.id, sighting.time, source, name, known, confidence FROM sighting "
                 "JOIN person ON person.id = sighting.person ORDER BY sighting.id DESC LIMIT ?");
  rows.bind(1, limit > 0 ? limit : std::int64_t{-1});
  std::vector<Sighting> out;
  while (rows.step())
    out.push_back({rows.integer(0), rows.integer(1), rows.text(2), rows.text(3),
                   rows.integer(4) != 0, rows.real(5)});
  return out;
}

std::int64_t Gallery::forget_sightings_before(std::int64_t time) {
  std::int64_t removed = 0;
  {
    Statement remove(database_, "DELETE FROM sighting WHERE time < ?");
    remove.bind(1, time);
    (void)remove.step();
    removed = database_.changed_rows();
  }
  if (removed > 0) database_.run("PRAGMA incremental_vacuum; PRAGMA wal_checkpoint(TRUNCATE)");
  return removed;
}

}  // namespace tarsier::people
