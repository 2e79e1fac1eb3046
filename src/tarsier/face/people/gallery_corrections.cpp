// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/image.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/people/gallery_rows.h"
#include "tarsier/face/people/name.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <utility>

// Manual corrections. Each is one transaction; two tables store what undoing it needs.
namespace tarsier::face::people {

// One row of the log, with additional data for undoing.
struct Gallery::Step {
  std::int64_t id = 0;
  std::string kind;
  std::int64_t source = 0;
  std::int64_t target = 0;
  std::string source_name;
  std::string target_name;
  bool made = false;       // the target was created by the correction
  std::string note;        // of the source, if it was removed
  std::int64_t since = 0;  // enrolment time of the source
  std::int64_t undone = 0;
  std::int64_t undoes = 0;
};

namespace {

constexpr std::size_t kMaxActor = 200;  // bytes

std::vector<std::int64_t> each_once(std::span<const std::int64_t> ids) {
  std::vector<std::int64_t> out(ids.begin(), ids.end());
  std::sort(out.begin(), out.end());
  out.erase(std::unique(out.begin(), out.end()), out.end());
  return out;
}

std::string group_name(std::int64_t group) { return fmt::format("group {}", group); }

[[noreturn]] void no_face(const std::string& path, std::int64_t face) {
  throw MissingEntryError(path, "face", fmt::format("there is no face {}", face));
}

[[noreturn]] void no_group(const std::string& path, std::int64_t group) {
  throw MissingEntryError(path, "group", fmt::format("there is no group {}", group));
}

}  // namespace

std::string text_of(const Correction& entry) {
  const std::string from = printable(entry.from);
  const std::string to = printable(entry.to);
  std::string what;
  if (entry.kind == "name") what = fmt::format("{} is {}", from, to);
  if (entry.kind == "not") what = fmt::format("not {}", from);
  if (entry.kind == "move") what = fmt::format("moved from {} to {}", from, to);
  if (entry.kind == "split") what = fmt::format("split off {}: {}", from, to);
  if (entry.kind == "merge") what = fmt::format("{} is {}: merged", from, to);
  if (entry.kind == "merge groups") what = fmt::format("{} merged into {}", from, to);
  if (entry.kind == "split group") what = fmt::format("split off {}: {}", from, to);
  if (entry.kind == "undo") what = fmt::format("undid {}", entry.undoes);
  if (entry.count > 0) what += fmt::format(" ({})", entry.count);
  if (entry.undone > 0) what += fmt::format(", undone by {}", entry.undone);
  return what;
}

std::int64_t Gallery::write_correction(const Step& step, const CorrectionStamp& stamp) {
  Statement insert(database_,
                   "INSERT INTO correction(time, actor, kind, source, target, source_name, "
                   "target_name, made, note, since, undone, undoes) VALUES(?, ?, ?, ?, ?, ?, ?, ?, "
                   "?, ?, 0, ?)");
  insert.bind(1, stamp.time)
      .bind(2, std::string_view(stamp.actor).substr(0, kMaxActor))
      .bind(3, std::string_view(step.kind))
      .bind(4, step.source)
      .bind(5, step.target)
      .bind(6, std::string_view(step.source_name))
      .bind(7, std::string_view(step.target_name))
      .bind(8, std::int64_t{step.made ? 1 : 0})
      .bind(9, std::string_view(step.note))
      .bind(10, step.since)
      .bind(11, step.undoes);
  (void)insert.step();
  return database_.last_row_id();
}

void Gallery::write_change(std::int64_t correction, std::string_view kind, std::int64_t row,
                           std::int64_t before) {
  Statement insert(database_,
                   "INSERT OR REPLACE INTO correction_row(correction, kind, row, before) VALUES(?, "
                   "?, ?, ?)");
  insert.bind(1, correction).bind(2, kind).bind(3, row).bind(4, before);
  (void)insert.step();
}

Person Gallery::require_person(std::string_view name) {
  auto person = find(name);
  if (!person)
    throw MissingEntryError(path(), "person", fmt::format("nobody is enrolled as '{}'", name));
  return *person;
}

std::int64_t Gallery::add_negative(std::int64_t person, const std::vector<std::uint8_t>& png,
                                   double quality, std::string_view measures,
                                   std::string_view source, std::int64_t time) {
  const std::string shown = masked(source);
  Statement insert(database_,
                   "INSERT INTO negative(person, crop, quality, measures, source, time) VALUES(?, "
                   "?, ?, ?, ?, ?)");
  insert.bind(1, person)
      .bind(2, std::span<const std::uint8_t>(png))
      .bind(3, quality)
      .bind(4, measures)
      .bind(5, std::string_view(shown).substr(0, kMaxSource))
      .bind(6, time);
  (void)insert.step();
  return database_.last_row_id();
}

std::int64_t Gallery::name_group(std::int64_t group, std::string_view name, std::string_view note,
                                 std::int64_t most, const CorrectionStamp& stamp) {
  TARSIER_REQUIRE(most >= 1, "{} faces", most);
  check_name(name);
  check_note(note);
  Transaction transaction(database_);
  std::vector<Sighting> members = group_sightings(group);
  if (members.empty()) no_group(path(), group);
  const auto before = find(name);
  const Person person = add_person(name, note, stamp.time);
  Step step;
  step.kind = "name";
  step.source = group;
  step.source_name = group_name(group);
  step.target = person.id;
  step.target_name = person.name;
  step.made = !before.has_value();
  const std::int64_t id = write_correction(step, stamp);
  // Best quality first; equal ones in order of time.
  std::vector<Sighting> best = members;
  std::stable_sort(best.begin(), best.end(),
                   [](const Sighting& a, const Sighting& b) { return a.quality > b.quality; });
  if (static_cast<std::int64_t>(best.size()) > most) best.resize(static_cast<std::size_t>(most));
  std::sort(best.begin(), best.end(),
            [](const Sighting& a, const Sighting& b) { return a.id < b.id; });
  for (const Sighting& sighting : best) {
    Statement copy(database_,
                   "INSERT INTO face(person, crop, quality, measures, source, time) SELECT ?, "
                   "crop, quality, measures, ?, ? FROM seen_face WHERE sighting = ?");
    copy.bind(1, person.id)
        .bind(2, std::string_view(sighting.source))
        .bind(3, sighting.time)
        .bind(4, sighting.id);
    (void)copy.step();
    write_change(id, "face", database_.last_row_id(), 0);
  }
  for (const Sighting& sighting : members) {
    Statement old(database_, "SELECT coalesce(person, 0) FROM sighting WHERE id = ?");
    old.bind(1, sighting.id);
    write_change(id, "sighting", sighting.id, old.step() ? old.integer(0) : 0);
  }
  run_statement(database_,
                "UPDATE sighting SET known = 1, person = ?2 WHERE id IN (SELECT sighting FROM "
                "seen_face WHERE grouped = ?1)",
                group, person.id);
  run_statement(database_, "UPDATE seen_face SET grouped = NULL WHERE grouped = ?1", group);
  run_statement(database_, "DELETE FROM sighting_group WHERE id = ?1", group);
  set_next_group(std::max(next_group(), group + 1));
  changed();
  transaction.commit();
  return id;
}

std::int64_t Gallery::not_this_face(std::int64_t face, const CorrectionStamp& stamp) {
  Transaction transaction(database_);
  Step step;
  std::int64_t negative = 0;
  {
    Statement row(database_,
                  "SELECT person, name, crop, quality, measures, source, face.time FROM face JOIN "
                  "person ON person.id = face.person WHERE face.id = ?");
    row.bind(1, face);
    if (!row.step()) no_face(path(), face);
    step.kind = "not";
    step.source = row.integer(0);
    step.source_name = row.text(1);
    negative = add_negative(row.integer(0), row.bytes(2), row.real(3), row.text(4), row.text(5),
                            row.integer(6));
  }
  const std::int64_t id = write_correction(step, stamp);
  write_change(id, "face", face, negative);
  run_statement(database_, "DELETE FROM template WHERE face = ?", face);
  run_statement(database_, "DELETE FROM face WHERE id = ?", face);
  count_removal();
  changed();
  transaction.commit();
  return id;
}

std::int64_t Gallery::not_this_sighting(std::int64_t sighting, const CorrectionStamp& stamp) {
  Transaction transaction(database_);
  Step step;
  std::int64_t negative = 0;
  bool known = false;
  {
    Statement row(database_,
                  "SELECT person, name, crop, quality, measures, source, sighting.time, known FROM "
                  "sighting LEFT JOIN person ON person.id = sighting.person LEFT JOIN seen_face ON "
                  "seen_face.sighting = sighting.id WHERE sighting.id = ?");
    row.bind(1, sighting);
    if (!row.step())
      throw MissingEntryError(path(), "sighting", fmt::format("there is no sighting {}", sighting));
    if (row.is_null(0))
      throw InputError(path(),
                       fmt::format("sighting {} has no name that can be removed", sighting));
    if (row.is_null(2))
      throw InputError(
          path(),
          fmt::format("no face of sighting {} was stored: `people correct not` needs a stored face",
                      sighting));
    step.kind = "not";
    step.source = row.integer(0);
    step.source_name = row.text(1);
    known = row.integer(7) != 0;
    negative = add_negative(row.integer(0), row.bytes(2), row.real(3), row.text(4), row.text(5),
                            row.integer(6));
  }
  const std::int64_t id = write_correction(step, stamp);
  write_change(id, "negative", negative, 0);
  write_change(id, "sighting", sighting, known ? 1 : 0);
  Statement update(database_, "UPDATE sighting SET known = 0, person = NULL WHERE id = ?");
  update.bind(1, sighting);
  (void)update.step();
  changed();
  transaction.commit();
  return id;
}

std::int64_t Gallery::not_this_person(std::string_view name, const SeenFace& face,
                                      std::string_view source, const CorrectionStamp& stamp) {
  require_gray(face.crop);
  TARSIER_REQUIRE(std::isfinite(face.quality), "quality {}", face.quality);
  Transaction transaction(database_);
  const Person person = require_person(name);
  const std::int64_t negative = add_negative(person.id, encode_image(".png", face.crop, path()),
                                             face.quality, face.measures, source, stamp.time);
  Step step;
  step.kind = "not";
  step.source = person.id;
  step.source_name = person.name;
  const std::int64_t id = write_correction(step, stamp);
  write_change(id, "negative", negative, 0);
  changed();
  transaction.commit();
  return id;
}

// Runs inside a transaction.
std::int64_t Gallery::hand_over(std::string_view kind, std::span<const std::int64_t> faces,
                                const Person& from, std::string_view to,
                                const CorrectionStamp& stamp) {
  const auto before = find(to);
  const Person target = add_person(to, "", stamp.time);
  Step step;
  step.kind = kind;
  step.source = from.id;
  step.source_name = from.name;
  step.target = target.id;
  step.target_name = target.name;
  step.made = !before.has_value();
  const std::int64_t id = write_correction(step, stamp);
  for (const std::int64_t face : faces) {
    write_change(id, "face", face, from.id);
    Statement update(database_, "UPDATE face SET person = ? WHERE id = ?");
    update.bind(1, target.id).bind(2, face);
    (void)update.step();
  }
  changed();
  return id;
}

std::int64_t Gallery::move_faces(std::span<const std::int64_t> faces, std::string_view to,
                                 const CorrectionStamp& stamp) {
  check_name(to);
  const std::vector<std::int64_t> ids = each_once(faces);
  if (ids.empty()) throw InputError(path(), "no face to move");
  Transaction transaction(database_);
  std::optional<Person> from;
  for (const std::int64_t face : ids) {
    Statement row(database_,
                  "SELECT name FROM face JOIN person ON person.id = face.person WHERE face.id = ?");
    row.bind(1, face);
    if (!row.step()) no_face(path(), face);
    const Person person = require_person(row.text(0));
    if (from && from->id != person.id)
      throw InputError(path(),
                       fmt::format("faces {} and {} belong to two people: move them separately",
                                   ids.front(), face));
    from = person;
  }
  if (from->name == to)
    throw InputError(path(), fmt::format("face {} is of '{}' already", ids.front(), to));
  const std::int64_t id = hand_over("move", ids, *from, to, stamp);
  transaction.commit();
  return id;
}

std::int64_t Gallery::split_person(std::string_view name, std::span<const std::int64_t> faces,
                                   std::string_view to, const CorrectionStamp& stamp) {
  check_name(to);
  const std::vector<std::int64_t> ids = each_once(faces);
  if (ids.empty()) throw InputError(path(), "no face to split off");
  Transaction transaction(database_);
  const Person person = require_person(name);
  if (find(to))
    throw InputError(
        path(),
        fmt::format("'{}' is enrolled already: `people correct move` gives faces to them", to));
  for (const std::int64_t face : ids) {
    Statement row(database_, "SELECT 1 FROM face WHERE id = ? AND person = ?");
    row.bind(1, face).bind(2, person.id);
    if (!row.step())
      throw MissingEntryError(path(), "face",
                              fmt::format("face {} is not one of '{}'", face, name));
  }
  if (static_cast<std::int64_t>(ids.size()) == person.faces)
    throw InputError(path(),
                     fmt::format("these are all faces of '{}': one at least must stay", name));
  const std::int64_t id = hand_over("split", ids, person, to, stamp);
  transaction.commit();
  return id;
}

std::int64_t Gallery::merge_people(std::string_view from, std::string_view into,
                                   const CorrectionStamp& stamp) {
  Transaction transaction(database_);
  const Person gone = require_person(from);
  const Person stays = require_person(into);
  if (gone.id == stays.id)
    throw InputError(path(), fmt::format("'{}' and '{}' are one person", from, into));
  Step step;
  step.kind = "merge";
  step.source = gone.id;
  step.source_name = gone.name;
  step.target = stays.id;
  step.target_name = stays.name;
  step.note = gone.note;
  step.since = gone.time;
  const std::int64_t id = write_correction(step, stamp);
  for (const char* table : {"face", "sighting", "negative"}) {
    run_statement(database_,
                  fmt::format("INSERT INTO correction_row(correction, kind, row, before) SELECT "
                              "?2, '{0}', id, ?1 FROM {0} WHERE person = ?1",
                              table),
                  gone.id, id);
    run_statement(database_, fmt::format("UPDATE {} SET person = ?2 WHERE person = ?1", table),
                  gone.id, stays.id);
  }
  run_statement(database_, "DELETE FROM person WHERE id = ?", gone.id);
  changed();
  transaction.commit();
  return id;
}

std::int64_t Gallery::merge_groups(std::int64_t from, std::int64_t into,
                                   const CorrectionStamp& stamp) {
  Transaction transaction(database_);
  for (const std::int64_t one : {from, into})
    if (!group(one)) no_group(path(), one);
  if (from == into) throw InputError(path(), fmt::format("group {} twice: name two groups", from));
  Step step;
  step.kind = "merge groups";
  step.source = from;
  step.target = into;
  step.source_name = group_name(from);
  step.target_name = group_name(into);
  const std::int64_t id = write_correction(step, stamp);
  for (const Sighting& sighting : group_sightings(from))
    write_change(id, "sighting", sighting.id, from);
  // 1: groups that were kept apart from the first group but not yet from the second.
  Statement apart(database_,
                  "SELECT b, EXISTS(SELECT 1 FROM group_apart AS other WHERE other.a = ?2 AND "
                  "other.b = group_apart.b) FROM group_apart WHERE a = ?1");
  apart.bind(1, from).bind(2, into);
  std::vector<std::pair<std::int64_t, std::int64_t>> rows;
  while (apart.step()) rows.emplace_back(apart.integer(0), apart.integer(1) != 0 ? 0 : 1);
  apart.reset();
  for (const auto& [other, added] : rows) write_change(id, "apart", other, added);
  join_groups(from, into);
  changed();
  transaction.commit();
  return id;
}

std::int64_t Gallery::split_group(std::int64_t group, std::span<const std::int64_t> sightings,
                                  const CorrectionStamp& stamp) {
  const std::vector<std::int64_t> ids = each_once(sightings);
  if (ids.empty()) throw InputError(path(), "no sighting to split off");
  Transaction transaction(database_);
  const std::vector<Sighting> members = group_sightings(group);
  if (members.empty()) no_group(path(), group);
  for (const std::int64_t sighting : ids)
    if (std::none_of(members.begin(), members.end(),
                     [&](const Sighting& one) { return one.id == sighting; }))
      throw MissingEntryError(path(), "member of a group",
                              fmt::format("sighting {} is not one of group {}", sighting, group));
  if (ids.size() == members.size())
    throw InputError(
        path(), fmt::format("these are all sightings of group {}: one at least must stay", group));
  const std::int64_t made = next_group();
  set_next_group(made + 1);
  Step step;
  step.kind = "split group";
  step.source = group;
  step.target = made;
  step.source_name = group_name(group);
  step.target_name = group_name(made);
  step.made = true;
  const std::int64_t id = write_correction(step, stamp);
  for (const char* statement : {"INSERT INTO sighting_group(id) SELECT ?2 WHERE ?1 > 0",
                                "INSERT INTO group_apart(a, b) VALUES(?1, ?2), (?2, ?1)"}) {
    Statement run(database_, statement);
    run.bind(1, group).bind(2, made);
    (void)run.step();
  }
  for (const std::int64_t sighting : ids) {
    write_change(id, "sighting", sighting, group);
    Statement update(database_, "UPDATE seen_face SET grouped = ? WHERE sighting = ?");
    update.bind(1, made).bind(2, sighting);
    (void)update.step();
  }
  changed();
  transaction.commit();
  return id;
}

namespace {

constexpr const char* kCorrections =
    "SELECT id, time, actor, kind, source_name, target_name, (SELECT count(*) FROM correction_row "
    "WHERE correction = correction.id AND kind <> 'apart'), undone, undoes FROM correction ";

Correction correction_at(const Statement& row) {
  return {row.integer(0), row.integer(1), row.text(2),    row.text(3),   row.text(4),
          row.text(5),    row.integer(6), row.integer(7), row.integer(8)};
}

}  // namespace

std::vector<Correction> Gallery::corrections(std::int64_t limit) {
  Statement rows(database_, std::string(kCorrections) + "ORDER BY id DESC LIMIT ?");
  rows.bind(1, limit > 0 ? limit : std::int64_t{-1});
  std::vector<Correction> out;
  while (rows.step()) out.push_back(correction_at(rows));
  return out;
}

std::optional<Correction> Gallery::correction(std::int64_t id) {
  Statement row(database_, std::string(kCorrections) + "WHERE id = ?");
  row.bind(1, id);
  if (!row.step()) return std::nullopt;
  return correction_at(row);
}

std::int64_t Gallery::undo(std::int64_t id, const CorrectionStamp& stamp) {
  Transaction transaction(database_);
  Step step;
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
    step.id = row.integer(0);
    step.kind = row.text(1);
    step.source = row.integer(2);
    step.target = row.integer(3);
    step.source_name = row.text(4);
    step.target_name = row.text(5);
    step.made = row.integer(6) != 0;
    step.note = row.text(7);
    step.since = row.integer(8);
    step.undone = row.integer(9);
  }
  if (step.kind == "undo")
    throw InputError(
        path(),
        fmt::format("correction {} is itself an undo: make a new correction instead", step.id));
  if (step.undone > 0)
    throw InputError(path(),
                     fmt::format("correction {} was undone already, by {}", step.id, step.undone));
  {
    // A later correction that changed the same rows, or removed the person of this one.
    Statement later(
        database_,
        "SELECT id, kind FROM correction AS later WHERE id > ?1 AND undone = 0 AND undoes = 0 AND "
        "(EXISTS(SELECT 1 FROM correction_row AS mine JOIN correction_row AS theirs ON "
        "theirs.kind = mine.kind AND theirs.row = mine.row WHERE mine.correction = ?1 AND "
        "theirs.correction = later.id AND mine.kind <> 'apart') OR (kind = 'merge' AND source IN "
        "(?2, ?3) AND ?4 = 0) OR (kind IN ('merge groups', 'name') AND source IN (?2, ?3) AND ?4 = "
        "1)) ORDER BY id DESC LIMIT 1");
    const bool groups = step.kind.ends_with("groups") || step.kind.ends_with("group");
    later.bind(1, step.id)
        .bind(2, step.source)
        .bind(3, step.target)
        .bind(4, std::int64_t{groups ? 1 : 0});
    if (later.step())
      throw InputError(
          path(), fmt::format("correction {} ({}) later changed the same entries: undo it first",
                              later.integer(0), later.text(1)));
  }
  take_back(step);
  Step undoing;
  undoing.kind = "undo";
  undoing.undoes = step.id;
  const std::int64_t undone = write_correction(undoing, stamp);
  Statement mark(database_, "UPDATE correction SET undone = ? WHERE id = ?");
  mark.bind(1, undone).bind(2, step.id);
  (void)mark.step();
  drop_empty_groups();
  changed();
  transaction.commit();
  return undone;
}

// Runs inside a transaction. Skips rows that were removed meanwhile (retention, forgetting).
void Gallery::take_back(const Step& step) {
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
    rows.bind(1, step.id);
    while (rows.step()) changes.push_back({rows.text(0), rows.integer(1), rows.integer(2)});
  }
  const auto make_group = [&](std::int64_t group) {
    Statement insert(database_, "INSERT OR IGNORE INTO sighting_group(id) VALUES(?)");
    insert.bind(1, group);
    (void)insert.step();
  };
  if (step.kind == "merge") {
    if (find(step.source_name))
      throw InputError(path(), fmt::format("a new person was enrolled as '{}' since: give those "
                                           "faces another name first, with `people correct move`",
                                           step.source_name));
    Statement insert(database_, "INSERT INTO person(id, name, note, time) VALUES(?, ?, ?, ?)");
    insert.bind(1, step.source)
        .bind(2, std::string_view(step.source_name))
        .bind(3, std::string_view(step.note))
        .bind(4, step.since);
    (void)insert.step();
    for (const Change& change : changes)
      run(fmt::format("UPDATE {} SET person = ?2 WHERE id = ?1", change.kind), change.row,
          step.source);
  } else if (step.kind == "move" || step.kind == "split") {
    for (const Change& change : changes)
      run("UPDATE face SET person = ?2 WHERE id = ?1", change.row, change.before);
  } else if (step.kind == "not") {
    for (const Change& change : changes) {
      if (change.kind == "face")
        run("INSERT INTO face(id, person, crop, quality, measures, source, time) SELECT ?1, "
            "person, "
            "crop, quality, measures, source, time FROM negative WHERE id = ?2",
            change.row, change.before);
      if (change.kind == "sighting") {
        run("UPDATE seen_face SET grouped = NULL WHERE sighting = ?1", change.row);
        run("UPDATE sighting SET person = ?2, known = ?3 WHERE id = ?1", change.row, step.source,
            change.before);
      }
      if (change.kind == "face") run("DELETE FROM negative WHERE id = ?1", change.before);
      if (change.kind == "negative") run("DELETE FROM negative WHERE id = ?1", change.row);
    }
  } else if (step.kind == "name") {
    make_group(step.source);
    for (const Change& change : changes) {
      if (change.kind == "face") {
        run("DELETE FROM template WHERE face = ?1", change.row);
        run("DELETE FROM face WHERE id = ?1", change.row);
        count_removal();
      } else {
        run("UPDATE sighting SET known = 0, person = (SELECT id FROM person WHERE id = ?2) WHERE "
            "id "
            "= ?1",
            change.row, change.before);
        run("UPDATE seen_face SET grouped = ?2 WHERE sighting = ?1", change.row, step.source);
      }
    }
  } else {
    make_group(step.source);
    for (const Change& change : changes) {
      if (change.kind == "sighting") {
        run("UPDATE seen_face SET grouped = ?2 WHERE sighting = ?1", change.row, step.source);
        continue;
      }
      if (change.before == 1) {
        run("DELETE FROM group_apart WHERE a = ?1 AND b = ?2", step.target, change.row);
        run("DELETE FROM group_apart WHERE a = ?2 AND b = ?1", step.target, change.row);
      }
      for (const char* statement :
           {"INSERT OR IGNORE INTO group_apart SELECT ?1, id FROM sighting_group WHERE id = ?2",
            "INSERT OR IGNORE INTO group_apart SELECT id, ?1 FROM sighting_group WHERE id = ?2"})
        run(statement, step.source, change.row);
    }
  }
  const bool of_people = step.kind == "move" || step.kind == "split" || step.kind == "name";
  if (!step.made || !of_people) return;
  // Remove a person whom the correction added, unless other faces of that person exist now.
  run("UPDATE sighting SET person = NULL, known = 0 WHERE person = ?1 AND NOT EXISTS(SELECT 1 FROM "
      "face WHERE person = ?1)",
      step.target);
  run("DELETE FROM person WHERE id = ?1 AND NOT EXISTS(SELECT 1 FROM face WHERE person = ?1)",
      step.target);
}

std::vector<Negative> Gallery::negatives() {
  Statement rows(database_, "SELECT id, person FROM negative ORDER BY id");
  std::vector<Negative> out;
  while (rows.step()) out.push_back({rows.integer(0), rows.integer(1)});
  return out;
}

cv::Mat Gallery::negative_crop(std::int64_t id) {
  Statement row(database_, "SELECT crop FROM negative WHERE id = ?");
  row.bind(1, id);
  if (!row.step()) return {};
  return crop_of(row.bytes(0), path(), id);
}

}  // namespace tarsier::face::people
