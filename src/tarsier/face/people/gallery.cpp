// SPDX-License-Identifier: MIT
#include "tarsier/face/people/gallery.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/face/people/gallery_rows.h"
#include "tarsier/face/people/name.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <span>
#include <system_error>
#include <utility>

namespace tarsier::face::people {
namespace {

// 'TPG1'
const DatabaseKind kKind{"Tarsier people gallery",
                         0x54504731,
                         {R"sql(
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
)sql",
                          // 2: templates in a table of their own, with a space
                          R"sql(
CREATE TABLE template(
  face INTEGER PRIMARY KEY REFERENCES face(id) ON DELETE CASCADE,
  space INTEGER NOT NULL,       -- > 0: id of the model; < 0: - fingerprint of the background
  numbers BLOB NOT NULL         -- float32, little-endian
) STRICT;
CREATE INDEX template_by_space ON template(space);
CREATE TABLE learned(
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  generation INTEGER NOT NULL,
  space INTEGER NOT NULL,       -- of the templates; 0: its own id
  body BLOB NOT NULL
) STRICT;
CREATE TABLE learned_face(face INTEGER PRIMARY KEY) STRICT;
INSERT INTO learned(generation, space, body) SELECT generation, 0, body FROM model;
INSERT INTO template SELECT face.id, learned.id, face.template FROM face, learned
  WHERE face.template IS NOT NULL;
INSERT INTO learned_face SELECT face FROM template;
DROP TABLE model;
ALTER TABLE face DROP COLUMN template;
)sql",
                          // 3: sightings with faces, their groups, and corrections
                          R"sql(
CREATE TABLE seen(
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  time INTEGER NOT NULL,
  source TEXT NOT NULL,
  person INTEGER REFERENCES person(id) ON DELETE CASCADE,  -- NULL: like nobody
  known INTEGER NOT NULL,
  confidence REAL NOT NULL
) STRICT;
INSERT INTO seen SELECT id, time, source, person, known, confidence FROM sighting;
DROP TABLE sighting;
ALTER TABLE seen RENAME TO sighting;
CREATE INDEX sighting_by_time ON sighting(time);
CREATE INDEX sighting_by_person ON sighting(person);
CREATE TABLE sighting_group(id INTEGER PRIMARY KEY) STRICT;
CREATE TABLE seen_face(
  sighting INTEGER PRIMARY KEY REFERENCES sighting(id) ON DELETE CASCADE,
  crop BLOB NOT NULL,           -- PNG
  quality REAL NOT NULL,
  measures TEXT NOT NULL,       -- JSON
  space INTEGER,                -- of the numbers, as template.space < 0; NULL: not made yet
  numbers BLOB,                 -- float32, little-endian
  grouped INTEGER REFERENCES sighting_group(id)  -- NULL: in no group
) STRICT;
CREATE INDEX seen_face_by_group ON seen_face(grouped);
CREATE TABLE group_apart(       -- of different people; both ways
  a INTEGER NOT NULL REFERENCES sighting_group(id) ON DELETE CASCADE,
  b INTEGER NOT NULL REFERENCES sighting_group(id) ON DELETE CASCADE,
  PRIMARY KEY(a, b)
) STRICT, WITHOUT ROWID;
CREATE TABLE negative(          -- faces that are not of the person
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  person INTEGER NOT NULL REFERENCES person(id) ON DELETE CASCADE,
  crop BLOB NOT NULL,           -- PNG
  quality REAL NOT NULL,
  measures TEXT NOT NULL,
  source TEXT NOT NULL,
  time INTEGER NOT NULL
) STRICT;
CREATE INDEX negative_by_person ON negative(person);
CREATE TABLE correction(
  id INTEGER PRIMARY KEY AUTOINCREMENT,
  time INTEGER NOT NULL,
  actor TEXT NOT NULL,
  kind TEXT NOT NULL,
  source INTEGER NOT NULL,      -- person or group that it takes from; 0: none
  target INTEGER NOT NULL,      -- that it gives to; 0: none
  source_name TEXT NOT NULL,
  target_name TEXT NOT NULL,
  made INTEGER NOT NULL,        -- the target did not exist before
  note TEXT NOT NULL,           -- of the source, where that is gone
  since INTEGER NOT NULL,       -- its time
  undone INTEGER NOT NULL,      -- by this correction; 0: it holds
  undoes INTEGER NOT NULL       -- this correction; 0: none
) STRICT;
CREATE TABLE correction_row(    -- what it changed
  correction INTEGER NOT NULL REFERENCES correction(id) ON DELETE CASCADE,
  kind TEXT NOT NULL,           -- face, negative, sighting, apart
  row INTEGER NOT NULL,
  before INTEGER NOT NULL,      -- what undoing needs to know
  PRIMARY KEY(correction, kind, row)
) STRICT, WITHOUT ROWID;
)sql",
                          // 4: negatives end with their sighting, or are overruled
                          R"sql(
ALTER TABLE negative ADD COLUMN sighting INTEGER REFERENCES sighting(id) ON DELETE CASCADE;
ALTER TABLE negative ADD COLUMN overruled INTEGER NOT NULL DEFAULT 0;  -- by this correction
CREATE INDEX negative_by_sighting ON negative(sighting);
CREATE TEMPORARY TABLE origin AS SELECT mine.row AS negative, theirs.row AS sighting FROM correction
  JOIN correction_row AS mine ON mine.correction = correction.id AND mine.kind = 'negative'
  JOIN correction_row AS theirs ON theirs.correction = correction.id AND theirs.kind = 'sighting'
  WHERE correction.kind = 'not';
DELETE FROM negative WHERE id IN
  (SELECT negative FROM origin WHERE sighting NOT IN (SELECT id FROM sighting));
UPDATE negative SET sighting = origin.sighting FROM origin WHERE origin.negative = negative.id;
UPDATE negative SET sighting = (SELECT sighting.id FROM sighting JOIN seen_face ON
  seen_face.sighting = sighting.id WHERE sighting.time = negative.time AND
  seen_face.crop = negative.crop LIMIT 1) WHERE sighting IS NULL;
DROP TABLE origin;
)sql"}};

// The file that a link leads to, also if it does not exist yet: SQLite writes its log beside it,
// and the index and the search after forgetting use its folder.
std::string without_links(const std::string& path) {
  constexpr int kMaxLinks = 40;
  std::filesystem::path file = path;
  std::error_code error;
  for (int i = 0; i < kMaxLinks && std::filesystem::is_symlink(file, error); ++i) {
    const std::filesystem::path target = std::filesystem::read_symlink(file, error);
    if (error) break;
    file = file.parent_path() / target;  // of an absolute target, the target
  }
  return file.string();
}

void put_templates(Database& database, std::int64_t space,
                   std::span<const std::pair<std::int64_t, std::vector<float>>> templates) {
  Statement insert(database,
                   "INSERT OR REPLACE INTO template(face, space, numbers) "
                   "SELECT id, ?, ? FROM face WHERE id = ?");
  for (const auto& [id, numbers] : templates) {
    insert.bind(1, space).bind(2, bytes_of(numbers)).bind(3, id);
    (void)insert.step();
    insert.reset();
  }
}

}  // namespace

Gallery::Gallery(const std::string& path, DatabaseAccess access, int timeout_ms)
    : database_(without_links(path), kKind, access, timeout_ms) {}

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
  increment_generation();
  return *find(name);
}

std::int64_t Gallery::add_face(const StoredFace& face) {
  require_gray(face.crop);
  TARSIER_REQUIRE(std::isfinite(face.quality), "quality {}", face.quality);
  TARSIER_REQUIRE(face.features.empty() || face.space != 0, "a template of no space");
  const std::vector<std::uint8_t> png = encode_image(".png", face.crop, path());
  const std::string masked_source = masked(face.source);
  {
    // The same face cannot show the person and somebody else.
    Statement remove(database_, "DELETE FROM negative WHERE person = ? AND crop = ?");
    remove.bind(1, face.person).bind(2, std::span<const std::uint8_t>(png));
    (void)remove.step();
  }
  {
    Statement insert(database_,
                     "INSERT INTO face(person, crop, quality, measures, source, time) "
                     "VALUES(?, ?, ?, ?, ?, ?)");
    insert.bind(1, face.person)
        .bind(2, std::span<const std::uint8_t>(png))
        .bind(3, face.quality)
        .bind(4, std::string_view(face.measures))
        .bind(5, std::string_view(masked_source).substr(0, kMaxSourceBytes))
        .bind(6, face.time);
    (void)insert.step();
  }
  const std::int64_t id = database_.last_row_id();
  if (!face.features.empty()) {
    Statement insert(database_, "INSERT INTO template(face, space, numbers) VALUES(?, ?, ?)");
    insert.bind(1, id).bind(2, face.space).bind(3, bytes_of(face.features));
    (void)insert.step();
  }
  increment_generation();
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

void Gallery::enroll(std::span<const NewFace> faces) {
  Transaction transaction(database_);
  for (const NewFace& entry : faces) {
    StoredFace filled = entry.face;
    filled.person = add_person(entry.name, entry.note, entry.face.time).id;
    (void)add_face(filled);
  }
  transaction.commit();
}

namespace {

std::string face_query(bool crops, const char* which) {
  return fmt::format(
      "SELECT id, person, {}, numbers, space, quality, measures, source, time FROM face LEFT JOIN "
      "template ON template.face = face.id {}",
      crops ? "crop" : "NULL", which);
}

}  // namespace

StoredFace Gallery::face_at(const Statement& row, bool crops) const {
  StoredFace face;
  face.id = row.integer(0);
  face.person = row.integer(1);
  if (crops) face.crop = crop_of(row.bytes(2), path(), face.id);
  face.features = numbers_of(row.bytes(3), path(), face.id);
  face.space = row.integer(4);
  face.quality = row.real(5);
  face.measures = row.text(6);
  face.source = row.text(7);
  face.time = row.integer(8);
  return face;
}

void Gallery::each_face(std::optional<std::int64_t> person, bool crops,
                        const std::function<void(StoredFace&&)>& take) {
  Statement rows(database_,
                 face_query(crops, person ? "WHERE person = ? ORDER BY id" : "ORDER BY id"));
  if (person) rows.bind(1, *person);
  while (rows.step()) take(face_at(rows, crops));
}

std::vector<StoredFace> Gallery::faces(std::optional<std::int64_t> person, bool crops) {
  std::vector<StoredFace> out;
  each_face(person, crops, [&](StoredFace&& face) { out.push_back(std::move(face)); });
  return out;
}

std::optional<StoredFace> Gallery::face(std::int64_t id) {
  Statement row(database_, face_query(true, "WHERE id = ?"));
  row.bind(1, id);
  if (!row.step()) return std::nullopt;
  return face_at(row, true);
}

std::vector<FaceRef> Gallery::face_refs() {
  // This query uses the index alone, so the rows are sorted here.
  Statement rows(database_, "SELECT id, person FROM face INDEXED BY face_by_person");
  std::vector<FaceRef> out;
  while (rows.step()) out.push_back({rows.integer(0), rows.integer(1)});
  std::sort(out.begin(), out.end(), [](const FaceRef& a, const FaceRef& b) { return a.id < b.id; });
  return out;
}

std::int64_t Gallery::face_count() {
  Statement row(database_, "SELECT count(*) FROM face");
  return row.step() ? row.integer(0) : 0;
}

std::int64_t Gallery::face_count_up_to(std::int64_t max_count) {
  Statement row(database_,
                "SELECT count(*) FROM (SELECT 1 FROM face INDEXED BY face_by_person LIMIT ?)");
  row.bind(1, max_count);
  return row.step() ? row.integer(0) : 0;
}

std::optional<StoredFace> Gallery::latest_face(std::int64_t person) {
  Statement row(database_, face_query(true, "WHERE person = ? ORDER BY id DESC LIMIT 1"));
  row.bind(1, person);
  if (!row.step()) return std::nullopt;
  return face_at(row, true);
}

std::int64_t Gallery::generation() {
  Statement row(database_, "SELECT value FROM setting WHERE name = 'generation'");
  return row.step() ? row.integer(0) : 0;
}

std::int64_t Gallery::group_generation() {
  Statement row(database_,
                "SELECT sum(CAST(value AS INTEGER)) FROM setting WHERE name IN ('generation', "
                "'group_changes')");
  return row.step() ? row.integer(0) : 0;
}

void Gallery::increment_generation() {
  database_.run(
      "INSERT INTO setting(name, value) VALUES('generation', '1') ON CONFLICT(name) DO UPDATE SET "
      "value = CAST(CAST(value AS INTEGER) + 1 AS TEXT)");
}

// Also removes the templates that depend on the model. Coordinates stay: they do not depend on
// other people.
void Gallery::drop_model() {
  database_.run(
      "DELETE FROM learned; DELETE FROM learned_face; DELETE FROM template WHERE space > 0");
}

// Returns whether the write-ahead log is now empty. Deleted rows were overwritten with zeros, so
// the file need not be rewritten.
bool Gallery::shrink_file() {
  database_.run("PRAGMA incremental_vacuum");
  Statement checkpoint(database_, "PRAGMA wal_checkpoint(TRUNCATE)");
  return checkpoint.step() && checkpoint.integer(0) == 0;
}

std::optional<std::int64_t> Gallery::store_model(
    std::string_view body, std::int64_t generation, std::int64_t space,
    std::span<const std::int64_t> learned,
    std::span<const std::pair<std::int64_t, std::vector<float>>> templates) {
  Transaction transaction(database_);
  for (const std::int64_t face : learned) {
    Statement row(database_, "SELECT 1 FROM face WHERE id = ?");
    row.bind(1, face);
    if (!row.step()) return std::nullopt;
  }
  database_.run("DELETE FROM learned; DELETE FROM learned_face");
  {
    Statement insert(database_, "INSERT INTO learned(generation, space, body) VALUES(?, ?, ?)");
    insert
        .bind(1, generation + 1)  // the value that increment_generation() sets below
        .bind(2, space)
        .bind(3, std::span(reinterpret_cast<const std::uint8_t*>(body.data()), body.size()));
    (void)insert.step();
  }
  const std::int64_t id = database_.last_row_id();
  {
    Statement insert(database_, "INSERT INTO learned_face(face) VALUES(?)");
    for (const std::int64_t face : learned) {
      insert.bind(1, face);
      (void)insert.step();
      insert.reset();
    }
  }
  {
    // Remove the templates of the previous model.
    Statement remove(database_, "DELETE FROM template WHERE space > 0 AND space <> ?");
    remove.bind(1, id);
    (void)remove.step();
  }
  put_templates(database_, space == 0 ? id : space, templates);
  increment_generation();
  transaction.commit();
  return id;
}

void Gallery::store_templates(
    std::int64_t space, std::span<const std::pair<std::int64_t, std::vector<float>>> templates) {
  Transaction transaction(database_);
  put_templates(database_, space, templates);
  transaction.commit();
}

std::optional<StoredModel> Gallery::model() {
  Statement row(database_,
                "SELECT id, generation, space, body FROM learned ORDER BY id DESC LIMIT 1");
  if (!row.step()) return std::nullopt;
  StoredModel out;
  out.id = row.integer(0);
  out.generation = row.integer(1);
  out.space = row.integer(2) == 0 ? out.id : row.integer(2);
  const std::vector<std::uint8_t> bytes = row.bytes(3);
  out.body.assign(bytes.begin(), bytes.end());
  return out;
}

std::int64_t Gallery::model_id() {
  Statement row(database_, "SELECT max(id) FROM learned");
  return row.step() ? row.integer(0) : 0;
}

std::int64_t Gallery::model_generation() {
  Statement row(database_, "SELECT generation FROM learned ORDER BY id DESC LIMIT 1");
  return row.step() ? row.integer(0) : -1;
}

void Gallery::each_template(
    std::int64_t space,
    const std::function<void(std::int64_t face, std::span<const float>)>& take) {
  Statement rows(database_, "SELECT face, numbers FROM template WHERE space = ? ORDER BY face");
  rows.bind(1, space);
  while (rows.step()) take(rows.integer(0), numbers_of(rows.bytes(1), path(), rows.integer(0)));
}

std::vector<float> Gallery::template_of(std::int64_t face, std::int64_t space) {
  Statement row(database_, "SELECT numbers FROM template WHERE face = ? AND space = ?");
  row.bind(1, face).bind(2, space);
  if (!row.step()) return {};
  return numbers_of(row.bytes(0), path(), face);
}

std::vector<std::int64_t> Gallery::without_template(std::int64_t space) {
  Statement rows(database_,
                 "SELECT id FROM face INDEXED BY face_by_person WHERE NOT EXISTS (SELECT 1 FROM "
                 "template WHERE space = ? AND template.face = face.id)");
  rows.bind(1, space);
  std::vector<std::int64_t> out;
  while (rows.step()) out.push_back(rows.integer(0));
  std::sort(out.begin(), out.end());
  return out;
}

std::string Gallery::setting(const char* name) {
  Statement row(database_, "SELECT value FROM setting WHERE name = ?");
  row.bind(1, std::string_view(name));
  return row.step() ? row.text(0) : std::string();
}

void Gallery::set_setting(const char* name, std::string_view value) {
  if (setting(name) == value) return;
  Transaction transaction(database_);
  {
    Statement insert(database_, "INSERT OR REPLACE INTO setting(name, value) VALUES(?, ?)");
    insert.bind(1, std::string_view(name));
    insert.bind(2, value);
    (void)insert.step();
  }
  drop_model();
  increment_generation();
  transaction.commit();
}

std::string Gallery::algorithm() {
  const std::string name = setting("algorithm");
  return name.empty() ? "default" : name;
}

void Gallery::set_algorithm(std::string_view name) {
  if (algorithm() != name) set_setting("algorithm", name);
}

std::string Gallery::network() { return setting("network"); }

void Gallery::set_network(std::string_view network) { set_setting("network", network); }

}  // namespace tarsier::face::people
