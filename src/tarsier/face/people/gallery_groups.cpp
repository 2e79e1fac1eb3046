// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"
#include "tarsier/core/require.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/people/gallery_rows.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/image_file.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

// Sightings, their stored faces, and their groups.
namespace tarsier::face::people {

std::int64_t Gallery::add_sighting(std::int64_t time, std::string_view source,
                                   std::string_view name, bool known, double confidence,
                                   const SightingFace* face) {
  TARSIER_REQUIRE(!known || !name.empty(), "a known face without a name");
  const std::string masked_source = masked(source);
  std::vector<std::uint8_t> png;
  if (face != nullptr) {
    require_gray(face->crop);
    TARSIER_REQUIRE(std::isfinite(face->quality), "quality {}", face->quality);
    png = encode_image(".png", face->crop, path());
  }
  Transaction transaction(database_);
  {
    Statement insert(database_,
                     name.empty() ? "INSERT INTO sighting(time, source, person, known, confidence) "
                                    "VALUES(?, ?, NULL, ?, ?)"
                                  : "INSERT INTO sighting(time, source, person, known, confidence) "
                                    "SELECT ?1, ?2, id, ?3, ?4 FROM person WHERE name = ?5");
    insert.bind(1, time)
        .bind(2, std::string_view(masked_source).substr(0, kMaxSourceBytes))
        .bind(3, std::int64_t{known ? 1 : 0})
        .bind(4, std::isfinite(confidence) ? confidence : 0.0);
    if (!name.empty()) insert.bind(5, name);
    (void)insert.step();
  }
  if (database_.changed_rows() == 0) return 0;
  const std::int64_t id = database_.last_row_id();
  if (face != nullptr) {
    Statement insert(database_,
                     "INSERT INTO seen_face(sighting, crop, quality, measures) VALUES(?, ?, ?, ?)");
    insert.bind(1, id)
        .bind(2, std::span<const std::uint8_t>(png))
        .bind(3, face->quality)
        .bind(4, std::string_view(face->measures));
    (void)insert.step();
  }
  transaction.commit();
  return id;
}

bool Gallery::improve_sighting(std::int64_t id, const SightingFace& face) {
  require_gray(face.crop);
  TARSIER_REQUIRE(std::isfinite(face.quality), "quality {}", face.quality);
  const std::vector<std::uint8_t> png = encode_image(".png", face.crop, path());
  Statement update(database_,
                   "UPDATE seen_face SET crop = ?, quality = ?, measures = ?, space = NULL, "
                   "numbers = NULL WHERE sighting = ? AND grouped IS NULL");
  update.bind(1, std::span<const std::uint8_t>(png))
      .bind(2, face.quality)
      .bind(3, std::string_view(face.measures))
      .bind(4, id);
  (void)update.step();
  return database_.changed_rows() > 0;
}

namespace {

constexpr const char* kSightings =
    "SELECT sighting.id, sighting.time, source, name, known, confidence, seen_face.sighting IS NOT "
    "NULL, quality, grouped FROM sighting LEFT JOIN person ON person.id = sighting.person LEFT "
    "JOIN seen_face ON seen_face.sighting = sighting.id ";

Sighting sighting_at(const Statement& row) {
  return {row.integer(0), row.integer(1),      row.text(2), row.text(3),   row.integer(4) != 0,
          row.real(5),    row.integer(6) != 0, row.real(7), row.integer(8)};
}

}  // namespace

std::vector<Sighting> Gallery::sightings(std::int64_t limit) {
  Statement rows(database_, std::string(kSightings) + "ORDER BY sighting.id DESC LIMIT ?");
  rows.bind(1, limit > 0 ? limit : std::int64_t{-1});
  std::vector<Sighting> out;
  while (rows.step()) out.push_back(sighting_at(rows));
  return out;
}

std::optional<Sighting> Gallery::sighting(std::int64_t id) {
  Statement row(database_, std::string(kSightings) + "WHERE sighting.id = ?");
  row.bind(1, id);
  if (!row.step()) return std::nullopt;
  return sighting_at(row);
}

std::int64_t Gallery::sighting_count() {
  Statement row(database_, "SELECT count(*) FROM sighting");
  return row.step() ? row.integer(0) : 0;
}

std::optional<SightingFace> Gallery::sighting_face(std::int64_t id) {
  Statement row(database_, "SELECT crop, quality, measures FROM seen_face WHERE sighting = ?");
  row.bind(1, id);
  if (!row.step()) return std::nullopt;
  return SightingFace{crop_of(row.bytes(0), path(), id), quality_of(row.real(1), path(), id),
                      row.text(2)};
}

std::int64_t Gallery::forget_sightings_before(std::int64_t time, std::int64_t max_count) {
  constexpr std::int64_t kMaxRemovedAtOnce = 500;
  const auto negative_count = [&] {
    Statement row(database_, "SELECT count(*) FROM negative");
    return row.step() ? row.integer(0) : 0;
  };
  std::int64_t removed = 0;
  while (removed < max_count) {
    const std::int64_t batch = std::min(kMaxRemovedAtOnce, max_count - removed);
    Transaction transaction(database_);
    const std::int64_t negatives = negative_count();
    Statement remove(database_,
                     "DELETE FROM sighting WHERE id IN (SELECT id FROM sighting WHERE time < ? "
                     "ORDER BY time LIMIT ?)");
    remove.bind(1, time).bind(2, batch);
    (void)remove.step();
    const std::int64_t rows = database_.changed_rows();
    removed += rows;
    if (rows > 0) {
      drop_empty_groups();
      increment_group_changes();
      if (negative_count() != negatives) increment_generation();
    }
    transaction.commit();
    if (rows < batch) break;
  }
  if (removed > 0) {
    database_.run("PRAGMA incremental_vacuum; PRAGMA wal_checkpoint(TRUNCATE)");
  }
  return removed;
}

void Gallery::drop_empty_groups() {
  database_.run(
      "DELETE FROM sighting_group WHERE NOT EXISTS (SELECT 1 FROM seen_face WHERE grouped = "
      "sighting_group.id)");
}

namespace {

constexpr const char* kGroups =
    "SELECT grouped, count(*), min(time), max(time) FROM seen_face JOIN sighting ON sighting.id = "
    "seen_face.sighting WHERE grouped {} GROUP BY grouped ORDER BY grouped";

}  // namespace

std::vector<SightingGroup> Gallery::groups() {
  Statement rows(database_, fmt::format(fmt::runtime(kGroups), "IS NOT NULL"));
  std::vector<SightingGroup> out;
  while (rows.step())
    out.push_back({rows.integer(0), rows.integer(1), rows.integer(2), rows.integer(3)});
  return out;
}

std::optional<SightingGroup> Gallery::group(std::int64_t id) {
  Statement row(database_, fmt::format(fmt::runtime(kGroups), "= ?"));
  row.bind(1, id);
  if (!row.step()) return std::nullopt;
  return SightingGroup{row.integer(0), row.integer(1), row.integer(2), row.integer(3)};
}

std::vector<Sighting> Gallery::group_sightings(std::int64_t group) {
  Statement rows(database_, std::string(kSightings) + "WHERE grouped = ? ORDER BY sighting.id");
  rows.bind(1, group);
  std::vector<Sighting> out;
  while (rows.step()) out.push_back(sighting_at(rows));
  return out;
}

std::vector<std::int64_t> Gallery::ungrouped() {
  Statement rows(database_,
                 "SELECT sighting FROM seen_face JOIN sighting ON sighting.id = seen_face.sighting "
                 "WHERE grouped IS NULL AND known = 0 ORDER BY sighting");
  std::vector<std::int64_t> out;
  while (rows.step()) out.push_back(rows.integer(0));
  return out;
}

std::int64_t Gallery::ungrouped_count() {
  Statement row(database_,
                "SELECT count(*) FROM seen_face JOIN sighting ON sighting.id = seen_face.sighting "
                "WHERE grouped IS NULL AND known = 0");
  return row.step() ? row.integer(0) : 0;
}

std::vector<float> Gallery::sighting_coordinates(std::int64_t sighting, std::int64_t space) {
  Statement row(database_, "SELECT numbers FROM seen_face WHERE sighting = ? AND space = ?");
  row.bind(1, sighting).bind(2, space);
  if (!row.step()) return {};
  return numbers_of(row.bytes(0), path(), sighting);
}

void Gallery::store_sighting_coordinates(
    std::int64_t space, std::span<const std::pair<std::int64_t, std::vector<float>>> numbers) {
  Transaction transaction(database_);
  Statement update(database_, "UPDATE seen_face SET space = ?, numbers = ? WHERE sighting = ?");
  for (const auto& [sighting, values] : numbers) {
    update.bind(1, space).bind(2, bytes_of(values)).bind(3, sighting);
    (void)update.step();
    update.reset();
  }
  transaction.commit();
}

void Gallery::each_grouped(const std::function<void(std::int64_t, std::int64_t, double)>& take) {
  Statement rows(database_,
                 "SELECT sighting, grouped, quality FROM seen_face WHERE grouped IS NOT NULL ORDER "
                 "BY sighting");
  while (rows.step())
    take(rows.integer(0), rows.integer(1), quality_of(rows.real(2), path(), rows.integer(0)));
}

std::vector<std::pair<std::int64_t, std::int64_t>> Gallery::cannot_link_pairs() {
  Statement rows(database_, "SELECT a, b FROM group_apart WHERE a < b ORDER BY a, b");
  std::vector<std::pair<std::int64_t, std::int64_t>> out;
  while (rows.step()) out.emplace_back(rows.integer(0), rows.integer(1));
  return out;
}

std::int64_t Gallery::next_group() {
  Statement row(database_,
                "SELECT max(coalesce((SELECT CAST(value AS INTEGER) FROM setting WHERE name = "
                "'next_group'), 1), coalesce((SELECT max(id) + 1 FROM sighting_group), 1))");
  return row.step() ? row.integer(0) : 1;
}

void Gallery::set_next_group(std::int64_t id) {
  Statement insert(database_,
                   "INSERT OR REPLACE INTO setting(name, value) VALUES('next_group', "
                   "CAST(? AS TEXT))");
  insert.bind(1, id);
  (void)insert.step();
}

void Gallery::increment_group_changes() {
  database_.run(
      "INSERT INTO setting(name, value) VALUES('group_changes', '1') ON CONFLICT(name) DO UPDATE "
      "SET value = CAST(CAST(value AS INTEGER) + 1 AS TEXT)");
}

// Groups that were kept apart from `from` are kept apart from `into`.
void Gallery::join_groups(std::int64_t from, std::int64_t into) {
  for (const char* statement :
       {"UPDATE seen_face SET grouped = ?2 WHERE grouped = ?1",
        "INSERT OR IGNORE INTO group_apart SELECT ?2, b FROM group_apart WHERE a = ?1 AND b <> ?2",
        "INSERT OR IGNORE INTO group_apart SELECT a, ?2 FROM group_apart WHERE b = ?1 AND a <> "
        "?2"})
    run_statement(database_, statement, from, into);
  run_statement(database_, "DELETE FROM sighting_group WHERE id = ?1", from);
}

bool Gallery::store_merges(std::span<const std::pair<std::int64_t, std::int64_t>> groups,
                           std::int64_t generation) {
  Transaction transaction(database_);
  if (group_generation() != generation) return false;
  for (const auto& [from, into] : groups) {
    for (const std::int64_t id : {from, into}) {
      Statement existing(database_, "SELECT 1 FROM sighting_group WHERE id = ?");
      existing.bind(1, id);
      if (!existing.step()) return false;
    }
    join_groups(from, into);
  }
  increment_group_changes();
  transaction.commit();
  return true;
}

bool Gallery::store_assignments(std::span<const SightingAssignment> assignments, std::int64_t next,
                                std::int64_t generation) {
  Transaction transaction(database_);
  if (group_generation() != generation) return false;
  for (const SightingAssignment& one : assignments) {
    {
      Statement existing(database_,
                         "SELECT 1 FROM seen_face WHERE sighting = ? AND grouped IS NULL");
      existing.bind(1, one.sighting);
      if (!existing.step()) return false;
    }
    // The group it was first placed in may have been merged into another one.
    const std::int64_t first = one.merged.empty() ? one.group : 0;
    if (first > 0) {
      Statement insert(database_, "INSERT OR IGNORE INTO sighting_group(id) VALUES(?)");
      insert.bind(1, first);
      (void)insert.step();
    }
    for (const auto& [from, into] : one.merged) join_groups(from, into);
    Statement update(database_, "UPDATE seen_face SET grouped = ? WHERE sighting = ?");
    update.bind(1, one.group).bind(2, one.sighting);
    (void)update.step();
  }
  set_next_group(next);
  increment_group_changes();
  transaction.commit();
  return true;
}

}  // namespace tarsier::face::people
