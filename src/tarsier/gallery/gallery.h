// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/gallery/byte_search.h"
#include "tarsier/io/sqlite.h"
#include "tarsier/people_face/quality.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

// Who is enrolled: an SQLite file of people, their faces and what was learned from them.
namespace tarsier::people {

struct Person {
  std::int64_t id = 0;
  std::string name;
  std::string note;       // of consent: who agreed to what, when
  std::int64_t time = 0;  // when enrolled, ms since 1970-01-01 UTC
  std::int64_t faces = 0;
};

// A face that is enrolled or going to be.
struct StoredFace {
  std::int64_t id = 0;
  std::int64_t person = 0;
  cv::Mat crop;                 // CV_8UC1, as cut_face() makes it
  std::vector<float> features;  // the template; empty: not made yet
  double quality = 0;           // 0..1
  std::string measures;         // JSON object of the quality's measures
  std::string source;           // file or camera, passwords masked
  std::int64_t time = 0;        // ms since 1970-01-01 UTC
};

struct Sighting {
  std::int64_t id = 0;
  std::int64_t time = 0;  // ms since 1970-01-01 UTC
  std::string source;
  std::string name;  // of the nearest person
  bool known = false;
  double confidence = 0;  // 0..1
};

struct ForgetReport {
  Person person;
  std::int64_t sightings = 0;
  SearchReport search;
  bool log_emptied = true;  // false: another program still reads the write-ahead log
  // Nothing is left that can be read.
  [[nodiscard]] bool proven() const {
    return log_emptied && search.found.empty() && search.unread.empty();
  }
};

// What is committed survives a crash; each face is one transaction. Errors as io/sqlite.h says;
// hostile files give InputError or OutputError naming the path.
class Gallery {
 public:
  explicit Gallery(const std::string& path, DatabaseAccess access = DatabaseAccess::kCreate,
                   int patience_ms = 5000);

  [[nodiscard]] std::vector<Person> people();  // in the order of their enrolment
  [[nodiscard]] std::optional<Person> find(std::string_view name);
  // Finds or adds; a note that is not empty replaces the old one. Throws UsageError (check_name).
  Person add_person(std::string_view name, std::string_view note, std::int64_t time);
  // Returns its id. The crop is kept as PNG.
  std::int64_t add_face(const StoredFace& face);
  // The person (added where new) and the face together or not at all.
  std::int64_t enroll(std::string_view name, std::string_view note, const StoredFace& face);
  // Of one person or of all, in the order of their enrolment. Without crops where `crops` is false.
  [[nodiscard]] std::vector<StoredFace> faces(std::optional<std::int64_t> person = std::nullopt,
                                              bool crops = true);
  [[nodiscard]] std::int64_t face_count();
  // The newest face of a person.
  [[nodiscard]] std::optional<StoredFace> latest_face(std::int64_t person);

  // Removes the person with faces, templates, sightings and all that was learned, gives the room
  // back, empties the write-ahead log, then searches the folder's files for 32-byte pieces of what
  // was removed. Nothing where nobody has that name. Throws Interrupted (in the search only).
  [[nodiscard]] std::optional<ForgetReport> forget(std::string_view name,
                                                   const std::stop_token& stop);

  // Changes with every enrolment and removal.
  [[nodiscard]] std::int64_t generation();
  // What was learned from generation `generation`, with the templates of all faces by id.
  void store_model(std::string_view body, std::int64_t generation,
                   const std::vector<std::pair<std::int64_t, std::vector<float>>>& templates);
  // Nothing where there is none, or the gallery changed since.
  [[nodiscard]] std::optional<std::string> model();
  // "default" where nothing was set.
  [[nodiscard]] std::string algorithm();
  void set_algorithm(std::string_view name);

  void add_sighting(std::int64_t time, std::string_view source, std::string_view name, bool known,
                    double confidence);
  // Newest first, at most `limit` (0: all).
  [[nodiscard]] std::vector<Sighting> sightings(std::int64_t limit = 0);
  // Those before `time` (ms); returns how many.
  std::int64_t forget_sightings_before(std::int64_t time);

  [[nodiscard]] const std::string& path() const { return database_.path(); }

 private:
  void changed();
  [[nodiscard]] bool give_back_room();
  Database database_;
};

}  // namespace tarsier::people
