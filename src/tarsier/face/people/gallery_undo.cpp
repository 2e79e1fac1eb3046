// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/people/gallery_rows.h"

#include <fmt/format.h>

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

// Undoing manual corrections.
namespace tarsier::face::people {

std::int64_t Gallery::undo(std::int64_t id, const CorrectionStamp& stamp) {
  Transaction transaction(database_);
  CorrectionRecord record;
  {
    Statement row(database_,
                  id > 0 ? "SELECT id, kind, source, target, source_name, target_name, made, note, "
                           "since, undone FROM correction WHERE id = ?"
                         : "SELECT id, kind, source, target, source_name, target_name, made, note, "
                           "since, undone FROM correction WHERE undone = 0 AND undoes = 0 AND id > "
                           "? ORDER BY id DESC LIMIT 1");
    row.bind(1, std::max<std::int64_t>(0, id));
    if (!row.step()) {
      if (id > 0)
        throw MissingEntryError(path(), "correction", fmt::format("there is no correction {}", id));
      throw InputError(path(), "there is nothing to undo");
    }
    record.id = row.integer(0);
    record.kind = row.text(1);
    record.source = row.integer(2);
    record.target = row.integer(3);
    record.source_name = row.text(4);
    record.target_name = row.text(5);
    record.target_created = row.integer(6) != 0;
    record.note = row.text(7);
    record.source_time = row.integer(8);
    record.undone = row.integer(9);
  }
  if (record.kind == "undo")
    throw InputError(
        path(),
        fmt::format("correction {} is itself an undo: make a new correction instead", record.id));
  if (record.undone > 0)
    throw InputError(
        path(), fmt::format("correction {} was undone already, by {}", record.id, record.undone));
  {
    // A later correction that changed the same rows, or removed the person of this one, or is of
    // the person whom this one added and whom undoing removes.
    Statement later(
        database_,
        "SELECT id, kind FROM correction AS later WHERE id > ?1 AND undone = 0 AND undoes = 0 AND "
        "(EXISTS(SELECT 1 FROM correction_row AS mine JOIN correction_row AS theirs ON "
        "theirs.kind = mine.kind AND theirs.row = mine.row WHERE mine.correction = ?1 AND "
        "theirs.correction = later.id AND mine.kind <> 'apart') OR (kind = 'merge' AND source IN "
        "(?2, ?3) AND ?4 = 0) OR (kind IN ('merge groups', 'name') AND source IN (?2, ?3) AND ?4 = "
        "1) OR (?5 = 1 AND kind NOT IN ('merge groups', 'split group') AND (target = ?3 OR (source "
        "= ?3 AND kind <> 'name')))) ORDER BY id DESC LIMIT 1");
    const bool groups = record.kind.ends_with("groups") || record.kind.ends_with("group");
    later.bind(1, record.id)
        .bind(2, record.source)
        .bind(3, record.target)
        .bind(4, std::int64_t{groups ? 1 : 0})
        .bind(5, std::int64_t{record.target_created && !groups ? 1 : 0});
    if (later.step())
      throw InputError(
          path(), fmt::format("correction {} ({}) later changed the same entries: undo it first",
                              later.integer(0), later.text(1)));
  }
  revert(record);
  CorrectionRecord undo_record;
  undo_record.kind = "undo";
  undo_record.undoes = record.id;
  const std::int64_t undone = write_correction(undo_record, stamp);
  Statement mark(database_, "UPDATE correction SET undone = ? WHERE id = ?");
  mark.bind(1, undone).bind(2, record.id);
  (void)mark.step();
  drop_empty_groups();
  increment_generation();
  transaction.commit();
  return undone;
}

// Restores a face that was made a negative. In a gallery with an index it gets a new id: the index
// is taken to hold every face up to the greatest id at its building.
void Gallery::restore_face(std::int64_t face, std::int64_t negative) {
  const std::int64_t same = index_record().empty() ? face : 0;
  run_statement(database_,
                "INSERT INTO face(id, person, crop, quality, measures, source, time) SELECT "
                "nullif(?2, 0), person, crop, quality, measures, source, time FROM negative WHERE "
                "id = ?1",
                negative, same);
  if (database_.changed_rows() == 0) return;  // removed meanwhile
  run_statement(database_, "DELETE FROM negative WHERE id = ?1", negative);
  if (same == face) return;
  const std::int64_t id = last_face();
  run_statement(database_, "UPDATE correction_row SET row = ?2 WHERE kind = 'face' AND row = ?1",
                face, id);
  run_statement(database_, "UPDATE learned_face SET face = ?2 WHERE face = ?1", face, id);
}

// Keeps a group apart from another one again, if that still exists.
void Gallery::restore_apart(std::int64_t group, std::int64_t other) {
  for (const char* statement :
       {"INSERT OR IGNORE INTO group_apart SELECT ?1, id FROM sighting_group WHERE id = ?2",
        "INSERT OR IGNORE INTO group_apart SELECT id, ?1 FROM sighting_group WHERE id = ?2"})
    run_statement(database_, statement, group, other);
}

// Runs inside a transaction. Skips rows that were removed meanwhile (retention, forgetting), and
// people who were removed meanwhile.
void Gallery::revert(const CorrectionRecord& record) {
  const auto run = [&](std::string_view statement, auto... numbers) {
    run_statement(database_, statement, numbers...);
  };
  struct Change {
    std::string kind;
    std::int64_t row;
    std::int64_t before;
  };
  std::vector<Change> changes;
  {
    Statement rows(database_,
                   "SELECT kind, row, before FROM correction_row WHERE correction = ? ORDER BY "
                   "kind, row");
    rows.bind(1, record.id);
    while (rows.step()) changes.push_back({rows.text(0), rows.integer(1), rows.integer(2)});
  }
  const auto make_group = [&](std::int64_t group) {
    Statement insert(database_, "INSERT OR IGNORE INTO sighting_group(id) VALUES(?)");
    insert.bind(1, group);
    (void)insert.step();
  };
  if (record.kind == "merge") {
    if (find(record.source_name))
      throw InputError(path(), fmt::format("a new person was enrolled as '{}' since: give those "
                                           "faces another name first, with `people correct move`",
                                           record.source_name));
    Statement insert(database_, "INSERT INTO person(id, name, note, time) VALUES(?, ?, ?, ?)");
    insert.bind(1, record.source)
        .bind(2, std::string_view(record.source_name))
        .bind(3, std::string_view(record.note))
        .bind(4, record.source_time);
    (void)insert.step();
    for (const Change& change : changes)
      run(fmt::format("UPDATE {} SET person = ?2 WHERE id = ?1", change.kind), change.row,
          record.source);
  } else if (record.kind == "move" || record.kind == "split") {
    for (const Change& change : changes)
      run("UPDATE face SET person = ?2 WHERE id = ?1 AND EXISTS(SELECT 1 FROM person WHERE id = "
          "?2)",
          change.row, change.before);
  } else if (record.kind == "not") {
    for (const Change& change : changes) {
      if (change.kind == "face") restore_face(change.row, change.before);
      if (change.kind == "sighting") {
        run("UPDATE seen_face SET grouped = NULL WHERE sighting = ?1", change.row);
        run("UPDATE sighting SET person = ?2, known = ?3 WHERE id = ?1 AND EXISTS(SELECT 1 FROM "
            "person WHERE id = ?2)",
            change.row, record.source, change.before);
      }
      if (change.kind == "negative") run("DELETE FROM negative WHERE id = ?1", change.row);
    }
  } else if (record.kind == "name") {
    make_group(record.source);
    for (const Change& change : changes) {
      if (change.kind == "face") {
        run("DELETE FROM template WHERE face = ?1", change.row);
        run("DELETE FROM face WHERE id = ?1", change.row);
        increment_removals();
      } else if (change.kind == "apart") {
        restore_apart(record.source, change.row);
      } else {
        run("UPDATE sighting SET known = 0, person = (SELECT id FROM person WHERE id = ?2) WHERE "
            "id "
            "= ?1",
            change.row, change.before);
        run("UPDATE seen_face SET grouped = ?2 WHERE sighting = ?1", change.row, record.source);
      }
    }
  } else {
    make_group(record.source);
    for (const Change& change : changes) {
      if (change.kind == "sighting") {
        run("UPDATE seen_face SET grouped = ?2 WHERE sighting = ?1", change.row, record.source);
        continue;
      }
      if (change.before == 1) {
        run("DELETE FROM group_apart WHERE a = ?1 AND b = ?2", record.target, change.row);
        run("DELETE FROM group_apart WHERE a = ?2 AND b = ?1", record.target, change.row);
      }
      restore_apart(record.source, change.row);
    }
  }
  run("UPDATE negative SET overruled = 0 WHERE overruled = ?1", record.id);
  const bool of_people = record.kind == "move" || record.kind == "split" || record.kind == "name";
  if (!record.target_created || !of_people) return;
  // Remove a person whom the correction added, unless other faces of that person exist now.
  run("UPDATE sighting SET person = NULL, known = 0 WHERE person = ?1 AND NOT EXISTS(SELECT 1 FROM "
      "face WHERE person = ?1)",
      record.target);
  run("DELETE FROM person WHERE id = ?1 AND NOT EXISTS(SELECT 1 FROM face WHERE person = ?1)",
      record.target);
}

}  // namespace tarsier::face::people
