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

namespace {

constexpr std::size_t kMaxActorBytes = 200;  // bytes

std::vector<std::int64_t> sorted_unique(std::span<const std::int64_t> ids) {
  std::vector<std::int64_t> out(ids.begin(), ids.end());
  std::sort(out.begin(), out.end());
  out.erase(std::unique(out.begin(), out.end()), out.end());
  return out;
}

std::string group_name(std::int64_t group) { return fmt::format("group {}", group); }

[[noreturn]] void throw_no_face(const std::string& path, std::int64_t face) {
  throw MissingEntryError(path, "face", fmt::format("there is no face {}", face));
}

[[noreturn]] void throw_no_group(const std::string& path, std::int64_t group) {
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
  if (entry.kind == "split" || entry.kind == "split group")
    what = fmt::format("split off from {} as {}", from, to);
  if (entry.kind == "merge" || entry.kind == "merge groups")
    what = fmt::format("{} merged into {}", from, to);
  if (entry.kind == "undo") what = fmt::format("undid {}", entry.undoes);
  if (entry.count > 0) what += fmt::format(" ({})", entry.count);
  if (entry.undone > 0) what += fmt::format(", undone by {}", entry.undone);
  return what;
}

std::int64_t Gallery::write_correction(const CorrectionRecord& record,
                                       const CorrectionStamp& stamp) {
  Statement insert(database_,
                   "INSERT INTO correction(time, actor, kind, source, target, source_name, "
                   "target_name, made, note, since, undone, undoes) VALUES(?, ?, ?, ?, ?, ?, ?, ?, "
                   "?, ?, 0, ?)");
  insert.bind(1, stamp.time)
      .bind(2, std::string_view(stamp.actor).substr(0, kMaxActorBytes))
      .bind(3, std::string_view(record.kind))
      .bind(4, record.source)
      .bind(5, record.target)
      .bind(6, std::string_view(record.source_name))
      .bind(7, std::string_view(record.target_name))
      .bind(8, std::int64_t{record.target_created ? 1 : 0})
      .bind(9, std::string_view(record.note))
      .bind(10, record.source_time)
      .bind(11, record.undoes);
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
                                   std::string_view source, std::int64_t time,
                                   std::int64_t sighting) {
  const std::string masked_source = masked(source);
  Statement insert(database_,
                   "INSERT INTO negative(person, crop, quality, measures, source, time, sighting) "
                   "VALUES(?, ?, ?, ?, ?, ?, nullif(?, 0))");
  insert.bind(1, person)
      .bind(2, std::span<const std::uint8_t>(png))
      .bind(3, quality)
      .bind(4, measures)
      .bind(5, std::string_view(masked_source).substr(0, kMaxSourceBytes))
      .bind(6, time)
      .bind(7, sighting);
  (void)insert.step();
  return database_.last_row_id();
}

// A face that a correction gave to the person does not rule the person out any more: negatives with
// the same crop, or of a sighting that is now of the person, end until the correction is undone.
void Gallery::overrule_negatives(std::int64_t person, std::int64_t correction) {
  run_statement(
      database_,
      "WITH changed AS (SELECT kind, row FROM correction_row WHERE correction = ?2) "
      "UPDATE negative SET overruled = ?2 WHERE person = ?1 AND overruled = 0 AND (EXISTS(SELECT 1 "
      "FROM face WHERE face.person = ?1 AND face.crop = negative.crop AND (face.id IN (SELECT row "
      "FROM changed WHERE kind = 'face')) <> (negative.id IN (SELECT row FROM changed WHERE kind = "
      "'negative'))) OR (negative.id NOT IN (SELECT row FROM changed WHERE kind = 'negative') AND "
      "EXISTS(SELECT 1 FROM sighting JOIN changed ON changed.row = sighting.id AND changed.kind = "
      "'sighting' WHERE sighting.id = negative.sighting AND known <> 0)))",
      person, correction);
}

std::int64_t Gallery::name_group(std::int64_t group, std::string_view name, std::string_view note,
                                 std::int64_t max_faces, const CorrectionStamp& stamp) {
  TARSIER_REQUIRE(max_faces >= 1, "{} faces", max_faces);
  check_name(name);
  check_note(note);
  Transaction transaction(database_);
  const std::vector<Sighting> members = group_sightings(group);
  if (members.empty()) throw_no_group(path(), group);
  const auto before = find(name);
  const Person person = add_person(name, note, stamp.time);
  CorrectionRecord record;
  record.kind = "name";
  record.source = group;
  record.source_name = group_name(group);
  record.target = person.id;
  record.target_name = person.name;
  record.target_created = !before.has_value();
  const std::int64_t id = write_correction(record, stamp);
  // Best quality first; equal ones in order of time.
  std::vector<Sighting> best = members;
  std::stable_sort(best.begin(), best.end(),
                   [](const Sighting& a, const Sighting& b) { return a.quality > b.quality; });
  if (static_cast<std::int64_t>(best.size()) > max_faces)
    best.resize(static_cast<std::size_t>(max_faces));
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
  run_statement(
      database_,
      "INSERT INTO correction_row(correction, kind, row, before) SELECT ?2, 'apart', b, 0 "
      "FROM group_apart WHERE a = ?1",
      group, id);
  run_statement(database_,
                "UPDATE sighting SET known = 1, person = ?2 WHERE id IN (SELECT sighting FROM "
                "seen_face WHERE grouped = ?1)",
                group, person.id);
  run_statement(database_, "UPDATE seen_face SET grouped = NULL WHERE grouped = ?1", group);
  run_statement(database_, "DELETE FROM sighting_group WHERE id = ?1", group);
  set_next_group(std::max(next_group(), group + 1));
  overrule_negatives(person.id, id);
  increment_generation();
  transaction.commit();
  return id;
}

std::int64_t Gallery::not_this_face(std::int64_t face, const CorrectionStamp& stamp) {
  Transaction transaction(database_);
  CorrectionRecord record;
  std::int64_t negative = 0;
  {
    Statement row(database_,
                  "SELECT person, name, crop, quality, measures, source, face.time, (SELECT "
                  "sighting.id FROM sighting JOIN seen_face ON seen_face.sighting = sighting.id "
                  "WHERE sighting.time = face.time AND seen_face.crop = face.crop LIMIT 1) FROM "
                  "face JOIN person ON person.id = face.person WHERE face.id = ?");
    row.bind(1, face);
    if (!row.step()) throw_no_face(path(), face);
    record.kind = "not";
    record.source = row.integer(0);
    record.source_name = row.text(1);
    negative = add_negative(row.integer(0), row.bytes(2), row.real(3), row.text(4), row.text(5),
                            row.integer(6), row.integer(7));
  }
  const std::int64_t id = write_correction(record, stamp);
  write_change(id, "face", face, negative);
  run_statement(database_, "DELETE FROM template WHERE face = ?", face);
  run_statement(database_, "DELETE FROM face WHERE id = ?", face);
  increment_removals();
  increment_generation();
  transaction.commit();
  return id;
}

std::int64_t Gallery::not_this_sighting(std::int64_t sighting, const CorrectionStamp& stamp) {
  Transaction transaction(database_);
  CorrectionRecord record;
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
    record.kind = "not";
    record.source = row.integer(0);
    record.source_name = row.text(1);
    known = row.integer(7) != 0;
    negative = add_negative(row.integer(0), row.bytes(2), row.real(3), row.text(4), row.text(5),
                            row.integer(6), sighting);
  }
  const std::int64_t id = write_correction(record, stamp);
  write_change(id, "negative", negative, 0);
  write_change(id, "sighting", sighting, known ? 1 : 0);
  Statement update(database_, "UPDATE sighting SET known = 0, person = NULL WHERE id = ?");
  update.bind(1, sighting);
  (void)update.step();
  increment_generation();
  transaction.commit();
  return id;
}

std::int64_t Gallery::not_this_person(std::string_view name, const SightingFace& face,
                                      std::string_view source, const CorrectionStamp& stamp) {
  require_gray(face.crop);
  TARSIER_REQUIRE(std::isfinite(face.quality), "quality {}", face.quality);
  Transaction transaction(database_);
  const Person person = require_person(name);
  const std::int64_t negative = add_negative(person.id, encode_image(".png", face.crop, path()),
                                             face.quality, face.measures, source, stamp.time, 0);
  CorrectionRecord record;
  record.kind = "not";
  record.source = person.id;
  record.source_name = person.name;
  const std::int64_t id = write_correction(record, stamp);
  write_change(id, "negative", negative, 0);
  increment_generation();
  transaction.commit();
  return id;
}

// Runs inside a transaction.
std::int64_t Gallery::reassign_faces(std::string_view kind, std::span<const std::int64_t> faces,
                                     const Person& from, std::string_view to,
                                     const CorrectionStamp& stamp) {
  const auto before = find(to);
  const Person target = add_person(to, "", stamp.time);
  CorrectionRecord record;
  record.kind = kind;
  record.source = from.id;
  record.source_name = from.name;
  record.target = target.id;
  record.target_name = target.name;
  record.target_created = !before.has_value();
  const std::int64_t id = write_correction(record, stamp);
  for (const std::int64_t face : faces) {
    write_change(id, "face", face, from.id);
    Statement update(database_, "UPDATE face SET person = ? WHERE id = ?");
    update.bind(1, target.id).bind(2, face);
    (void)update.step();
  }
  overrule_negatives(target.id, id);
  increment_generation();
  return id;
}

std::int64_t Gallery::move_faces(std::span<const std::int64_t> faces, std::string_view to,
                                 const CorrectionStamp& stamp) {
  check_name(to);
  const std::vector<std::int64_t> ids = sorted_unique(faces);
  if (ids.empty()) throw InputError(path(), "no face to move");
  Transaction transaction(database_);
  std::optional<Person> from;
  for (const std::int64_t face : ids) {
    Statement row(database_,
                  "SELECT name FROM face JOIN person ON person.id = face.person WHERE face.id = ?");
    row.bind(1, face);
    if (!row.step()) throw_no_face(path(), face);
    const Person person = require_person(row.text(0));
    if (from && from->id != person.id)
      throw InputError(path(),
                       fmt::format("faces {} and {} belong to two people: move them separately",
                                   ids.front(), face));
    from = person;
  }
  if (from->name == to)
    throw InputError(path(), fmt::format("face {} is of '{}' already", ids.front(), to));
  const std::int64_t id = reassign_faces("move", ids, *from, to, stamp);
  transaction.commit();
  return id;
}

std::int64_t Gallery::split_person(std::string_view name, std::span<const std::int64_t> faces,
                                   std::string_view to, const CorrectionStamp& stamp) {
  check_name(to);
  const std::vector<std::int64_t> ids = sorted_unique(faces);
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
  const std::int64_t id = reassign_faces("split", ids, person, to, stamp);
  transaction.commit();
  return id;
}

std::int64_t Gallery::merge_people(std::string_view from, std::string_view into,
                                   const CorrectionStamp& stamp) {
  Transaction transaction(database_);
  const Person source = require_person(from);
  const Person target = require_person(into);
  if (source.id == target.id)
    throw InputError(path(), fmt::format("'{}' and '{}' are one person", from, into));
  CorrectionRecord record;
  record.kind = "merge";
  record.source = source.id;
  record.source_name = source.name;
  record.target = target.id;
  record.target_name = target.name;
  record.note = source.note;
  record.source_time = source.time;
  const std::int64_t id = write_correction(record, stamp);
  for (const char* table : {"face", "sighting", "negative"}) {
    run_statement(database_,
                  fmt::format("INSERT INTO correction_row(correction, kind, row, before) SELECT "
                              "?2, '{0}', id, ?1 FROM {0} WHERE person = ?1",
                              table),
                  source.id, id);
    run_statement(database_, fmt::format("UPDATE {} SET person = ?2 WHERE person = ?1", table),
                  source.id, target.id);
  }
  run_statement(database_, "DELETE FROM person WHERE id = ?", source.id);
  overrule_negatives(target.id, id);
  increment_generation();
  transaction.commit();
  return id;
}

std::int64_t Gallery::merge_groups(std::int64_t from, std::int64_t into,
                                   const CorrectionStamp& stamp) {
  Transaction transaction(database_);
  for (const std::int64_t one : {from, into})
    if (!group(one)) throw_no_group(path(), one);
  if (from == into) throw InputError(path(), fmt::format("group {} twice: name two groups", from));
  CorrectionRecord record;
  record.kind = "merge groups";
  record.source = from;
  record.target = into;
  record.source_name = group_name(from);
  record.target_name = group_name(into);
  const std::int64_t id = write_correction(record, stamp);
  for (const Sighting& sighting : group_sightings(from))
    write_change(id, "sighting", sighting.id, from);
  // 1: groups that were kept apart from the first group but not yet from the second.
  Statement cannot_link(
      database_,
      "SELECT b, EXISTS(SELECT 1 FROM group_apart AS other WHERE other.a = ?2 AND "
      "other.b = group_apart.b) FROM group_apart WHERE a = ?1");
  cannot_link.bind(1, from).bind(2, into);
  std::vector<std::pair<std::int64_t, std::int64_t>> rows;
  while (cannot_link.step())
    rows.emplace_back(cannot_link.integer(0), cannot_link.integer(1) != 0 ? 0 : 1);
  cannot_link.reset();
  for (const auto& [other, added] : rows) write_change(id, "apart", other, added);
  join_groups(from, into);
  increment_generation();
  transaction.commit();
  return id;
}

std::int64_t Gallery::split_group(std::int64_t group, std::span<const std::int64_t> sightings,
                                  const CorrectionStamp& stamp) {
  const std::vector<std::int64_t> ids = sorted_unique(sightings);
  if (ids.empty()) throw InputError(path(), "no sighting to split off");
  Transaction transaction(database_);
  const std::vector<Sighting> members = group_sightings(group);
  if (members.empty()) throw_no_group(path(), group);
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
  CorrectionRecord record;
  record.kind = "split group";
  record.source = group;
  record.target = made;
  record.source_name = group_name(group);
  record.target_name = group_name(made);
  record.target_created = true;
  const std::int64_t id = write_correction(record, stamp);
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
  increment_generation();
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
  Statement rows(database_, fmt::format("{}ORDER BY id DESC LIMIT ?", kCorrections));
  rows.bind(1, limit > 0 ? limit : std::int64_t{-1});
  std::vector<Correction> out;
  while (rows.step()) out.push_back(correction_at(rows));
  return out;
}

std::optional<Correction> Gallery::correction(std::int64_t id) {
  Statement row(database_, fmt::format("{}WHERE id = ?", kCorrections));
  row.bind(1, id);
  if (!row.step()) return std::nullopt;
  return correction_at(row);
}

namespace {

std::vector<Negative> negatives_of(Database& database, const char* condition) {
  Statement rows(database, fmt::format("SELECT id, person, quality, source, time FROM negative "
                                       "WHERE overruled {} ORDER BY id",
                                       condition));
  std::vector<Negative> out;
  while (rows.step())
    out.push_back({rows.integer(0), rows.integer(1), rows.real(2), rows.text(3), rows.integer(4)});
  return out;
}

}  // namespace

std::vector<Negative> Gallery::negatives() { return negatives_of(database_, "= 0"); }

std::vector<Negative> Gallery::overruled_negatives() { return negatives_of(database_, "<> 0"); }

cv::Mat Gallery::negative_crop(std::int64_t id) {
  Statement row(database_, "SELECT crop FROM negative WHERE id = ?");
  row.bind(1, id);
  if (!row.step()) return {};
  return crop_of(row.bytes(0), path(), id);
}

}  // namespace tarsier::face::people
