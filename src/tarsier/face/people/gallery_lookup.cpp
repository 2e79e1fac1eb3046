// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/people/gallery_rows.h"

#include <fmt/format.h>

#include <charconv>
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

// Queries for a gallery's index.
namespace tarsier::face::people {
namespace {

constexpr const char* kIndex = "index";        // SHA-256 of the gallery's index files
constexpr const char* kRemovals = "removals";  // number of removals of faces

std::string listed(std::span<const std::int64_t> numbers) {
  std::string text;
  for (const std::int64_t number : numbers) {
    if (!text.empty()) text += ',';
    text += std::to_string(number);
  }
  return text;
}

std::int64_t number_of(const std::string& text) {
  std::int64_t value = 0;
  (void)std::from_chars(text.data(), text.data() + text.size(), value);
  return value;
}

}  // namespace

std::int64_t Gallery::last_face() {
  Statement row(database_, "SELECT max(id) FROM face");
  return row.step() ? row.integer(0) : 0;
}

std::int64_t Gallery::people_with_faces() {
  Statement row(database_,
                "SELECT count(*) FROM person WHERE EXISTS (SELECT 1 FROM face INDEXED BY "
                "face_by_person WHERE face.person = person.id)");
  return row.step() ? row.integer(0) : 0;
}

std::int64_t Gallery::template_count(std::int64_t space, std::int64_t last, std::int64_t after) {
  Statement row(database_,
                "SELECT count(*) FROM template INDEXED BY template_by_space WHERE space = ? AND "
                "face > ? AND face <= ?");
  row.bind(1, space).bind(2, after).bind(3, last);
  return row.step() ? row.integer(0) : 0;
}

void Gallery::each_template_after(
    std::int64_t space, std::int64_t after, std::int64_t last, std::int64_t max_count,
    const std::function<void(std::int64_t face, std::span<const float>)>& take) {
  Statement rows(database_,
                 "SELECT face, numbers FROM template NOT INDEXED WHERE face > ? AND face <= ? AND "
                 "space = ? ORDER BY face LIMIT ?");
  rows.bind(1, after).bind(2, last).bind(3, space).bind(4, max_count);
  while (rows.step()) take(rows.integer(0), numbers_of(rows.bytes(1), path(), rows.integer(0)));
}

std::vector<PersonTemplate> Gallery::templates_of_same_people(std::span<const std::int64_t> faces,
                                                              std::int64_t space) {
  std::vector<PersonTemplate> out;
  if (faces.empty()) return out;
  std::vector<std::int64_t> people;
  {
    Statement rows(database_,
                   fmt::format("SELECT DISTINCT person FROM face WHERE id IN ({})", listed(faces)));
    while (rows.step()) people.push_back(rows.integer(0));
  }
  Statement rows(database_, fmt::format("SELECT person, face, numbers FROM face INDEXED BY "
                                        "face_by_person CROSS JOIN template ON template.face = "
                                        "face.id WHERE person IN ({}) AND +space = ?",
                                        listed(people)));
  rows.bind(1, space);
  while (rows.step())
    out.push_back(
        {rows.integer(0), rows.integer(1), numbers_of(rows.bytes(2), path(), rows.integer(1))});
  return out;
}

std::string Gallery::name_of(std::int64_t person) {
  Statement row(database_, "SELECT name FROM person WHERE id = ?");
  row.bind(1, person);
  return row.step() ? row.text(0) : std::string();
}

void Gallery::put_setting(const char* name, std::string_view value) {
  Statement insert(database_, "INSERT OR REPLACE INTO setting(name, value) VALUES(?, ?)");
  insert.bind(1, std::string_view(name));
  insert.bind(2, value);
  (void)insert.step();
}

std::int64_t Gallery::removals() { return number_of(setting(kRemovals)); }

void Gallery::increment_removals() { put_setting(kRemovals, std::to_string(removals() + 1)); }

bool Gallery::is_index(std::string_view sha256) {
  return !sha256.empty() && setting(kIndex).find(sha256) != std::string::npos;
}

std::string Gallery::index_record() { return setting(kIndex); }

std::vector<std::int64_t> Gallery::without_template_after(std::int64_t space, std::int64_t after) {
  Statement rows(database_,
                 "SELECT id FROM face WHERE id > ? AND NOT EXISTS (SELECT 1 FROM template WHERE "
                 "template.face = face.id AND space = ?) ORDER BY id");
  rows.bind(1, after).bind(2, space);
  std::vector<std::int64_t> out;
  while (rows.step()) out.push_back(rows.integer(0));
  return out;
}

bool Gallery::put_index(std::int64_t removals, std::int64_t model, std::string_view sha256,
                        const std::function<void()>& put) {
  TARSIER_REQUIRE(!sha256.empty(), "an index without a sum");
  const auto same = [&] { return this->removals() == removals && model_id() == model; };
  {
    // Until the file is in place, both the old and the new index are valid.
    Transaction transaction(database_);
    if (!same()) return false;
    put_setting(kIndex, fmt::format("{} {}", setting(kIndex).substr(0, sha256.size()), sha256));
    transaction.commit();
  }
  Transaction transaction(database_);
  if (!same()) return false;
  put();
  put_setting(kIndex, sha256);
  increment_generation();
  transaction.commit();
  return true;
}

}  // namespace tarsier::face::people
