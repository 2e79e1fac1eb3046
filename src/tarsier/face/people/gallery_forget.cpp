// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/people/gallery_index.h"
#include "tarsier/face/people/gallery_rows.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <span>
#include <system_error>
#include <utility>

// Forgetting people: deletes their data, and searches the folder for what is left of them.
namespace tarsier::face::people {

namespace {

std::string folder_of(const std::string& path) {
  return std::filesystem::path(path).parent_path().string();
}

// Bytes that all PNGs of the same size share: signature, header, start of the data chunk.
constexpr std::size_t kPngHeaderBytes = 43;

// All stored face data: enrolled faces, sightings and negatives, each with the person to whom it
// belongs, the person as whom it was seen, and its group. Unknown sightings are of nobody (0), also
// those with a nearest person.
constexpr const char* kStoredFaceData = R"sql((
SELECT person AS owner, 0 AS seen_as, 0 AS grouped, crop, numbers
  FROM face LEFT JOIN template ON template.face = face.id
UNION ALL SELECT iif(known <> 0, coalesce(person, 0), 0), 0, coalesce(grouped, 0), crop, numbers
  FROM seen_face JOIN sighting ON sighting.id = seen_face.sighting
UNION ALL SELECT negative.person, iif(known <> 0, coalesce(sighting.person, 0), 0),
  coalesce(grouped, 0), negative.crop, NULL
  FROM negative LEFT JOIN sighting ON sighting.id = negative.sighting
  LEFT JOIN seen_face ON seen_face.sighting = negative.sighting))sql";

}  // namespace

// Reads the secret data of a face: its crop without the common PNG header, and its template.
void Gallery::each_stored_face_data(
    const std::string& condition, std::int64_t value,
    const std::function<void(std::int64_t, std::span<const std::uint8_t>)>& take) {
  Statement rows(database_, fmt::format("SELECT owner, crop, numbers FROM {} WHERE {}",
                                        kStoredFaceData, condition));
  rows.bind(1, value);
  while (rows.step()) {
    const std::vector<std::uint8_t> crop = rows.bytes(1);
    const std::vector<std::uint8_t> numbers = rows.bytes(2);
    if (crop.size() > kPngHeaderBytes)
      take(rows.integer(0), std::span(crop).subspan(kPngHeaderBytes));
    if (!numbers.empty()) take(rows.integer(0), numbers);
  }
}

std::optional<ForgetReport> Gallery::forget(std::string_view name, const std::stop_token& stop,
                                            const SearchLimits& limits) {
  const std::optional<Person> person = find(name);
  if (!person) return std::nullopt;
  return forget_matching(ForgetScope::kPerson, person->id, stop, limits);
}

bool Gallery::is_in_log(std::string_view name) {
  Transaction transaction(database_);
  return remove_log_entries(0, name) > 0;  // not committed
}

std::int64_t Gallery::forget_in_log(std::string_view name) {
  Transaction transaction(database_);
  const std::int64_t removed = remove_log_entries(0, name);
  transaction.commit();
  if (removed > 0) (void)shrink_file();
  return removed;
}

std::optional<ForgetReport> Gallery::forget_group(std::int64_t group, const std::stop_token& stop,
                                                  const SearchLimits& limits) {
  {
    Statement row(database_, "SELECT 1 FROM sighting_group WHERE id = ?");
    row.bind(1, group);
    if (!row.step()) return std::nullopt;
  }
  return forget_matching(ForgetScope::kGroup, group, stop, limits);
}

std::optional<ForgetReport> Gallery::forget_all(const std::stop_token& stop,
                                                const SearchLimits& limits) {
  return forget_matching(ForgetScope::kAll, 0, stop, limits);
}

std::optional<ForgetReport> Gallery::forget_matching(ForgetScope what, std::int64_t id,
                                                     const std::stop_token& stop,
                                                     const SearchLimits& limits) {
  ForgetReport report;
  const bool group = what == ForgetScope::kGroup;
  const std::string own = what == ForgetScope::kPerson ? "= ?" : ">= ?";  // ids are greater than 0
  const std::string secrets = group                          ? "grouped = ?"
                              : what == ForgetScope::kPerson ? "? IN (owner, seen_as)"
                                                             : "owner >= ?";
  const std::string seen = group ? "id IN (SELECT sighting FROM seen_face WHERE grouped = ?)"
                           : what == ForgetScope::kPerson ? "known <> 0 AND person = ?"
                                                          : "id >= ?";
  const auto count = [&](const std::string& query) {
    Statement row(database_, query);
    row.bind(1, id);
    return row.step() ? row.integer(0) : 0;
  };
  if (!group) {
    report.people = count("SELECT count(*) FROM person WHERE id " + own);
    if (report.people == 0 &&
        (what == ForgetScope::kPerson || count("SELECT count(*) FROM sighting WHERE id >= ?") == 0))
      return std::nullopt;
    if (what == ForgetScope::kPerson) {
      Statement row(database_,
                    "SELECT id, name, note, time, (SELECT count(*) FROM face WHERE person = "
                    "person.id) FROM person WHERE id = ?");
      row.bind(1, id);
      if (row.step()) report.person = person_at(row, path());
    }
    report.person.faces = count("SELECT count(*) FROM face WHERE person " + own);
  }
  Pieces pieces(count(fmt::format(
      "SELECT coalesce(sum(length(crop) + coalesce(length(numbers), 0)), 0) FROM {} WHERE {}",
      kStoredFaceData, secrets)));
  each_stored_face_data(
      secrets, id, [&](std::int64_t, std::span<const std::uint8_t> bytes) { pieces.add(bytes); });
  const auto learned_from_them = [&] {
    return !group && model_id() != 0 &&
           count(
               "SELECT count(*) FROM learned_face WHERE face IN (SELECT id FROM face WHERE "
               "person " +
               own + ")") > 0;
  };
  IndexRemoval index(*this);
  index.prepare(
      [&] {
        std::vector<std::int64_t> stay;
        for (const FaceRef& ref : face_refs())
          if (group || (what == ForgetScope::kPerson && ref.person != id)) stay.push_back(ref.id);
        return stay;
      },
      learned_from_them(), stop);
  {
    Transaction transaction(database_);
    report.sightings = count("SELECT count(*) FROM sighting WHERE " + seen);
    const auto remove = [&](const std::string& statement) {
      Statement removal(database_, statement);
      removal.bind(1, id);
      (void)removal.step();
    };
    if (!group) {
      report.model_removed = learned_from_them();
      if (report.model_removed) drop_model();
    }
    remove("DELETE FROM sighting WHERE " + seen);  // and their faces
    if (what == ForgetScope::kPerson) {
      // Unknown people whom this person resembles stay.
      remove("UPDATE sighting SET person = NULL WHERE person = ?");
      // The same face may have been rejected as somebody else's.
      remove("DELETE FROM negative WHERE crop IN (SELECT crop FROM face WHERE person = ?)");
    }
    if (!group) {
      for (const char* statement :
           {"DELETE FROM template WHERE face IN (SELECT id FROM face WHERE person {}) ",
            "DELETE FROM negative WHERE person ", "DELETE FROM face WHERE person ",
            "DELETE FROM person WHERE id "}) {
        const std::string text(statement);
        const auto at = text.find("{}");
        remove(at == std::string::npos ? text + own
                                       : text.substr(0, at) + own + text.substr(at + 2));
      }
    }
    // Corrections name these people and could restore them.
    if (what == ForgetScope::kAll) {
      database_.run("DELETE FROM correction");
    } else if (group) {
      remove(
          "DELETE FROM correction WHERE (kind IN ('merge groups', 'split group') AND ?1 IN "
          "(source, target)) OR (kind = 'name' AND source = ?1)");
      remove_undo_entries();
    } else {
      (void)remove_log_entries(id, report.person.name);
    }
    drop_empty_groups();
    if (!group) increment_removals();
    put_setting("index", index.replace(setting("index")));
    report.index = index.outcome();
    increment_generation();
    transaction.commit();
  }
  index.finish();
  report.log_emptied = shrink_file();
  report.search = search_below(pieces, folder_of(path()), stop, limits);
  if (!report.search.files_with_pieces.empty() && what != ForgetScope::kAll) {
    // Ignore pieces that faces of other people also contain. They are read only if something was
    // found.
    std::vector<std::int64_t> others;
    each_stored_face_data(
        "owner >= ?", 0, [&](std::int64_t other, std::span<const std::uint8_t> bytes) {
          throw_if_stopped(stop);
          if (pieces.exclude(bytes) > 0 && (others.empty() || others.back() != other))
            others.push_back(other);
        });
    std::sort(others.begin(), others.end());
    others.erase(std::unique(others.begin(), others.end()), others.end());
    for (const std::int64_t other : others) {
      Statement row(database_, "SELECT name FROM person WHERE id = ?");
      row.bind(1, other);
      report.shared_with.push_back(row.step() ? row.text(0) : "unknown");
    }
  }
  const auto is_gallery = [&](const std::string& file) {
    std::error_code error;
    return std::filesystem::equivalent(file, path(), error);
  };
  report.gallery_searched =
      std::any_of(report.search.files.begin(), report.search.files.end(), is_gallery);
  const auto search_again = [&] {
    const std::vector<std::string> suspects = std::exchange(report.search.files_with_pieces, {});
    std::int64_t ignored = 0;
    report.search.files_with_pieces =
        search_files(pieces, suspects, report.search.unreadable, ignored, stop);
  };
  if (!report.search.files_with_pieces.empty()) {
    search_again();
    // SQLite may have left bytes of moved rows in the free space of a page.
    const auto own_file = [&](const std::string& file) {
      return is_gallery(file) ||
             file.ends_with(std::filesystem::path(path()).filename().string() + "-wal");
    };
    if (std::any_of(report.search.files_with_pieces.begin(), report.search.files_with_pieces.end(),
                    own_file)) {
      database_.vacuum();
      report.log_emptied = shrink_file();
      search_again();
    }
  }
  report.total_pieces = pieces.total();
  report.searched_pieces = static_cast<std::int64_t>(pieces.count());
  report.shared_pieces = static_cast<std::int64_t>(pieces.excluded());
  report.unproven_records = static_cast<std::int64_t>(pieces.unproven_source_count());
  return report;
}

// Deletes the entries that name a person who is being forgotten (`person`; 0: none), everybody with
// this name who is not enrolled any more, and everybody who was merged into one of them. Returns
// their number. Runs inside a transaction.
std::int64_t Gallery::remove_log_entries(std::int64_t person, std::string_view name) {
  Statement remove(
      database_,
      "WITH RECURSIVE gone(id) AS (SELECT ?1 WHERE ?1 > 0 UNION "
      "SELECT source FROM correction WHERE source_name = ?2 AND kind IN ('not', 'move', 'merge', "
      "'split') AND source NOT IN (SELECT id FROM person) UNION "
      "SELECT target FROM correction WHERE target_name = ?2 AND kind IN ('name', 'move', 'merge', "
      "'split') AND target NOT IN (SELECT id FROM person) UNION "
      "SELECT source FROM correction JOIN gone ON target = gone.id WHERE kind = 'merge' AND source "
      "NOT IN (SELECT id FROM person)) "
      "DELETE FROM correction WHERE (kind IN ('name', 'move', 'merge', 'split') AND target IN "
      "(SELECT id FROM gone)) OR (kind IN ('not', 'move', 'merge', 'split') AND source IN (SELECT "
      "id FROM gone))");
  remove.bind(1, person).bind(2, name);
  (void)remove.step();
  const std::int64_t removed = database_.changed_rows();
  remove_undo_entries();
  return removed;
}

// Deletes entries of undoing corrections that are not in the log any more.
void Gallery::remove_undo_entries() {
  database_.run(
      "DELETE FROM correction WHERE undoes > 0 AND undoes NOT IN (SELECT id FROM correction)");
}

}  // namespace tarsier::face::people
