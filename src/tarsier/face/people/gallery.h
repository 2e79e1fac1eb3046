// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/people/byte_search.h"
#include "tarsier/face/people/quality.h"
#include "tarsier/media/sqlite.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <functional>
#include <limits>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

// Who is enrolled: an SQLite file of people, their faces and what was learned from them; who was
// seen, in what groups; what was corrected.
namespace tarsier::face::people {

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
  std::int64_t space = 0;       // what its numbers are of, see StoredModel; 0: no template
  double quality = 0;           // 0..1
  std::string measures;         // JSON object of the quality's measures
  std::string source;           // file or camera, passwords masked
  std::int64_t time = 0;        // ms since 1970-01-01 UTC
};

struct FaceRef {
  std::int64_t id = 0;
  std::int64_t person = 0;
};

// A face with the person whom it shows.
struct NewFace {
  std::string name;
  std::string note;
  StoredFace face;
};

// What was learned. Templates are of a space: that of a model (its id, > 0), or coordinates in the
// directions of a background (minus its fingerprint, < 0), which depend on nobody who is enrolled.
struct StoredModel {
  std::int64_t id = 0;
  std::int64_t generation = 0;  // of the gallery when it was learned
  std::int64_t space = 0;       // its own id, or the coordinates that it was learned in
  std::string body;
};

// A face as it was seen.
struct SeenFace {
  cv::Mat crop;          // CV_8UC1, as cut_face() makes it
  double quality = 0;    // 0..1
  std::string measures;  // JSON object of the quality's measures
};

struct Sighting {
  std::int64_t id = 0;
  std::int64_t time = 0;  // ms since 1970-01-01 UTC
  std::string source;
  std::string name;  // of the nearest person; empty: like nobody
  bool known = false;
  double confidence = 0;   // 0..1
  bool has_face = false;   // its crop is kept
  double quality = 0;      // of it, 0..1
  std::int64_t group = 0;  // of an unknown face; 0: none
};

// Sightings of unknown faces that show one person.
struct SightingGroup {
  std::int64_t id = 0;
  std::int64_t sightings = 0;
  std::int64_t first_time = 0;  // ms since 1970-01-01 UTC
  std::int64_t last_time = 0;
};

// A face that is not of a person.
struct Negative {
  std::int64_t id = 0;
  std::int64_t person = 0;
};

// What somebody corrected. Each is one transaction, and is undone by another.
struct Correction {
  std::int64_t id = 0;
  std::int64_t time = 0;  // ms since 1970-01-01 UTC
  std::string actor;      // who
  // "name", "not", "move", "merge", "split", "merge groups", "split group", "undo"
  std::string kind;
  std::string from;  // person, or "group 3"; empty: none
  std::string to;
  std::int64_t count = 0;   // faces, sightings or negatives that it changed
  std::int64_t undone = 0;  // by this correction; 0: it holds
  std::int64_t undoes = 0;  // this correction; 0: it is no undo
};

// "group 3 is Ann (4), undone by 7": without the time and who it was.
[[nodiscard]] std::string text_of(const Correction& entry);

// Who corrects, and when: for the log.
struct CorrectionStamp {
  std::int64_t time = 0;  // ms since 1970-01-01 UTC
  std::string actor;
};

// What became of a gallery's index (gallery_index.h) when somebody was forgotten.
enum class IndexFate {
  kNone,       // there was none
  kKept,       // it held none of the faces
  kRewritten,  // it was written without them
  kDeleted,    // it was learned from them, or could not be used
};

// A template with whose it is.
struct PersonTemplate {
  std::int64_t person = 0;
  std::int64_t face = 0;
  std::vector<float> numbers;
};

struct ForgetReport {
  Person person;            // with the number of faces that were removed; of all: no name
  std::int64_t people = 0;  // that were removed
  std::int64_t sightings = 0;
  bool unlearned = false;     // the model was learned from these faces: it was removed as well
  std::int64_t pieces = 0;    // runs of 32 bytes of the removed crops and templates
  std::int64_t searched = 0;  // of these so many were looked for
  std::int64_t shared = 0;    // and so many were not, as faces of others who stay hold them, too:
  std::vector<std::string> shared_with;  // of these people
  // Of so many removed crops and templates less than half of the pieces could be looked for (the
  // same image is enrolled under another name): nothing is proven of them.
  std::int64_t unproven = 0;
  IndexFate index = IndexFate::kNone;
  SearchReport search;
  bool log_emptied = true;  // false: another program still reads the write-ahead log
  // What was removed was looked for, all that is in and below the folder could be searched, and
  // nothing was found. Never true where there was nothing to look for.
  [[nodiscard]] bool proven() const {
    return log_emptied && searched > 0 && unproven == 0 && search.found.empty() &&
           search.unread.empty() && search.skipped.empty();
  }
};

// What is committed survives a crash; each face is one transaction. Errors as media/sqlite.h says;
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
  // Several at a time, in one transaction.
  void enroll(std::span<const NewFace> faces);
  // Of one person or of all, in the order of their enrolment, one after the other. Without crops
  // where `crops` is false. The gallery must not be written to meanwhile by the same object.
  void each_face(std::optional<std::int64_t> person, bool crops,
                 const std::function<void(StoredFace&&)>& take);
  // The same at once: all crops of a large gallery do not fit into memory.
  [[nodiscard]] std::vector<StoredFace> faces(std::optional<std::int64_t> person = std::nullopt,
                                              bool crops = true);
  [[nodiscard]] std::optional<StoredFace> face(std::int64_t id);
  // All, in the order of their enrolment: reads neither crops nor templates.
  [[nodiscard]] std::vector<FaceRef> face_refs();
  [[nodiscard]] std::int64_t face_count();
  // face_count(), counted no further than to `most`.
  [[nodiscard]] std::int64_t face_count_up_to(std::int64_t most);
  // The newest face of a person.
  [[nodiscard]] std::optional<StoredFace> latest_face(std::int64_t person);

  // Removes the person with faces, templates and sightings, and the model where it was learned from
  // one of these faces; gives the room back, empties the write-ahead log, then searches the files
  // in and below the gallery's folder for 32-byte pieces of what was removed. Nothing where nobody
  // has that name. Throws Interrupted (in the search only).
  [[nodiscard]] std::optional<ForgetReport> forget(std::string_view name,
                                                   const std::stop_token& stop,
                                                   const SearchLimits& limits = {});
  // The same of everybody, at once. Nothing where nobody is enrolled.
  [[nodiscard]] std::optional<ForgetReport> forget_all(const std::stop_token& stop,
                                                       const SearchLimits& limits = {});

  // A group of unknown faces, in the same way.
  [[nodiscard]] std::optional<ForgetReport> forget_group(std::int64_t group,
                                                         const std::stop_token& stop,
                                                         const SearchLimits& limits = {});

  // Changes with every enrolment and removal and with what is learned, whichever program does it:
  // one look-up.
  [[nodiscard]] std::int64_t generation();
  // Replaces what was learned, from generation `generation`, of the faces `learned`. `space` 0: the
  // model's own, with these templates. Returns its id; nothing, and nothing is stored, where one of
  // the faces was removed meanwhile.
  std::optional<std::int64_t> store_model(
      std::string_view body, std::int64_t generation, std::int64_t space,
      std::span<const std::int64_t> learned,
      std::span<const std::pair<std::int64_t, std::vector<float>>> templates);
  // What was learned last, even if the gallery changed since.
  [[nodiscard]] std::optional<StoredModel> model();
  [[nodiscard]] std::int64_t model_id();          // 0: nothing is stored
  [[nodiscard]] std::int64_t model_generation();  // -1: nothing is stored
  // Templates of faces by id; those of faces that are gone are left out.
  void store_templates(std::int64_t space,
                       std::span<const std::pair<std::int64_t, std::vector<float>>> templates);
  // Of a space, by rising id of their faces.
  void each_template(std::int64_t space,
                     const std::function<void(std::int64_t face, std::span<const float>)>& take);
  [[nodiscard]] std::vector<float> template_of(std::int64_t face, std::int64_t space);  // or empty
  // Faces without a template of this space, by rising id.
  [[nodiscard]] std::vector<std::int64_t> without_template(std::int64_t space);
  // gallery_lookup.cpp: what an index of the gallery (gallery_index.h) needs.
  [[nodiscard]] std::int64_t last_face();  // the greatest id; 0: no faces
  [[nodiscard]] std::int64_t people_with_faces();
  // Templates of a space of faces up to `last`, and after `after`.
  [[nodiscard]] std::int64_t template_count(std::int64_t space, std::int64_t last,
                                            std::int64_t after = 0);
  // At most `most` of these, by rising id: a large gallery is read in pieces, so that others can
  // empty its log meanwhile.
  void each_template_after(
      std::int64_t space, std::int64_t after, std::int64_t last, std::int64_t most,
      const std::function<void(std::int64_t face, std::span<const float>)>& take);
  // All templates of the people who have one of these faces.
  [[nodiscard]] std::vector<PersonTemplate> templates_beside(std::span<const std::int64_t> faces,
                                                             std::int64_t space);
  [[nodiscard]] std::string name_of(std::int64_t person);  // empty: they are gone
  [[nodiscard]] std::int64_t removals();  // how often enrolled faces were removed: rises
  // Whether an index of this sum is that of the gallery as it is.
  [[nodiscard]] bool is_index(std::string_view sum);
  // The sums of those that are; empty: none is.
  [[nodiscard]] std::string index_record();
  // Faces after `after` without a template of this space, by rising id.
  [[nodiscard]] std::vector<std::int64_t> without_template_after(std::int64_t space,
                                                                 std::int64_t after);
  // An index that was made of the templates of `model` is the gallery's from now on: `put` puts the
  // file into its place. False, and nothing is done, where faces were removed since `removals` or
  // the model is another. After a kill the old one or the new one is the gallery's.
  bool put_index(std::int64_t removals, std::int64_t model, std::string_view sum,
                 const std::function<void()>& put);

  // "default" where nothing was set.
  [[nodiscard]] std::string algorithm();
  void set_algorithm(std::string_view name);
  // The network of the user's own that makes the templates, "SHA256 NAME" of its file; empty: none.
  [[nodiscard]] std::string network();
  void set_network(std::string_view network);

  // Returns its id. `name` empty: like nobody. 0, and nothing is stored, where nobody has that name
  // (any more). `face` may be null: it is not kept.
  std::int64_t add_sighting(std::int64_t time, std::string_view source, std::string_view name,
                            bool known, double confidence, const SeenFace* face = nullptr);
  // A better image of the same face; false where it is gone, or in a group already.
  bool improve_sighting(std::int64_t id, const SeenFace& face);
  // Newest first, at most `limit` (0: all).
  [[nodiscard]] std::vector<Sighting> sightings(std::int64_t limit = 0);
  [[nodiscard]] std::optional<Sighting> sighting(std::int64_t id);
  [[nodiscard]] std::int64_t sighting_count();
  [[nodiscard]] std::optional<SeenFace> sighting_face(std::int64_t id);
  // gallery_groups.cpp
  [[nodiscard]] std::vector<SightingGroup> groups();
  [[nodiscard]] std::optional<SightingGroup> group(std::int64_t id);
  [[nodiscard]] std::vector<Sighting> group_sightings(std::int64_t group);  // in their order
  // Unknown faces that are in no group yet, in their order.
  [[nodiscard]] std::vector<std::int64_t> ungrouped();
  [[nodiscard]] std::int64_t ungrouped_count();
  // Numbers of unknown faces in a space (< 0, as templates have it), or empty where they are not
  // made yet.
  [[nodiscard]] std::vector<float> sighting_numbers(std::int64_t sighting, std::int64_t space);
  void store_sighting_numbers(std::int64_t space,
                              std::span<const std::pair<std::int64_t, std::vector<float>>> numbers);
  // Each sighting of a group, in their order.
  void each_grouped(
      const std::function<void(std::int64_t sighting, std::int64_t group, double quality)>& take);
  // Groups of different people, each pair once.
  [[nodiscard]] std::vector<std::pair<std::int64_t, std::int64_t>> groups_apart();
  [[nodiscard]] std::int64_t next_group();
  // What placing a sighting did, see SightingGroups.
  struct Placed {
    std::int64_t sighting = 0;
    std::int64_t group = 0;
    std::vector<std::pair<std::int64_t, std::int64_t>> merged;
  };
  // In one transaction, with the id of the next group. False, and nothing is stored, where groups
  // or sightings are no longer what they were in `generation`.
  bool place(std::span<const Placed> placed, std::int64_t next, std::int64_t generation);
  // Groups that show one person: the first of each pair becomes part of the second, in this order. In
  // one transaction, and as above.
  bool unite(std::span<const std::pair<std::int64_t, std::int64_t>> groups,
             std::int64_t generation);

  // gallery_corrections.cpp. All throw InputError, which says what to do, for ids, names and groups
  // that do not exist or cannot be changed so, and UsageError for new names (check_name); nothing
  // is changed then. Each returns its id in the log.
  // A group of unknown faces is this person: the best `most` of its faces are enrolled, its
  // sightings are theirs.
  std::int64_t name_group(std::int64_t group, std::string_view name, std::string_view note,
                          std::int64_t most, const CorrectionStamp& stamp);
  // An enrolled face, or a sighting, is not of the person whose it is: from now on it speaks
  // against them.
  std::int64_t not_this_face(std::int64_t face, const CorrectionStamp& stamp);
  std::int64_t not_this_sighting(std::int64_t sighting, const CorrectionStamp& stamp);
  // A face that is seen now, and was never stored, is not of this person.
  std::int64_t not_this_person(std::string_view name, const SeenFace& face, std::string_view source,
                               const CorrectionStamp& stamp);
  // Faces of one person are of another, who is added where new.
  std::int64_t move_faces(std::span<const std::int64_t> faces, std::string_view to,
                          const CorrectionStamp& stamp);
  // Some faces of a person are of a new one.
  std::int64_t split_person(std::string_view name, std::span<const std::int64_t> faces,
                            std::string_view to, const CorrectionStamp& stamp);
  // Two names of one person: the first is gone.
  std::int64_t merge_people(std::string_view from, std::string_view into,
                            const CorrectionStamp& stamp);
  std::int64_t merge_groups(std::int64_t from, std::int64_t into, const CorrectionStamp& stamp);
  // Sightings of a group are of somebody else: a group of their own, which stays apart.
  std::int64_t split_group(std::int64_t group, std::span<const std::int64_t> sightings,
                           const CorrectionStamp& stamp);
  // Undoes a correction, or the last one that holds (id 0). What retention or `forget` has removed
  // since stays removed.
  std::int64_t undo(std::int64_t id, const CorrectionStamp& stamp);
  // Newest first, at most `limit` (0: all).
  [[nodiscard]] std::vector<Correction> corrections(std::int64_t limit = 0);
  [[nodiscard]] std::optional<Correction> correction(std::int64_t id);
  [[nodiscard]] std::vector<Negative> negatives();
  [[nodiscard]] cv::Mat negative_crop(std::int64_t id);  // empty where it is gone

  // Those before `time` (ms); returns how many. A few hundred in each transaction, so that others
  // who write into the gallery do not wait; `most`: no more than so many in all.
  std::int64_t forget_sightings_before(
      std::int64_t time, std::int64_t most = std::numeric_limits<std::int64_t>::max());

  [[nodiscard]] const std::string& path() const { return database_.path(); }

 private:
  [[nodiscard]] std::string setting(const char* name);  // empty: not set
  void set_setting(const char* name, std::string_view value);
  void put_setting(const char* name, std::string_view value);
  void count_removal();
  void changed();
  void drop_model();
  [[nodiscard]] StoredFace face_at(const Statement& row, bool crops);
  enum class Forgotten { kPerson, kGroup, kAll };
  std::optional<ForgetReport> forget_those(Forgotten what, std::int64_t id,
                                           const std::stop_token& stop, const SearchLimits& limits);
  // `condition` has one parameter.
  void each_secret(
      const std::string& condition, std::int64_t value,
      const std::function<void(std::int64_t owner, std::span<const std::uint8_t>)>& take);
  void drop_empty_groups();
  void set_next_group(std::int64_t id);
  void join_groups(std::int64_t from, std::int64_t into);
  [[nodiscard]] Person require_person(std::string_view name);
  struct Step;
  std::int64_t write_correction(const Step& step, const CorrectionStamp& stamp);
  void write_change(std::int64_t correction, std::string_view kind, std::int64_t row,
                    std::int64_t before);
  std::int64_t add_negative(std::int64_t person, const std::vector<std::uint8_t>& png,
                            double quality, std::string_view measures, std::string_view source,
                            std::int64_t time);
  std::int64_t hand_over(std::string_view kind, std::span<const std::int64_t> faces,
                         const Person& from, std::string_view to, const CorrectionStamp& stamp);
  void take_back(const Step& step);
  [[nodiscard]] bool give_back_room();
  Database database_;
};

}  // namespace tarsier::face::people
