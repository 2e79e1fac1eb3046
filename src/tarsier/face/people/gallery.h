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

// The gallery: an SQLite file of enrolled people, their faces and the trained model. It also stores
// sightings, the groups of unknown faces, and manual corrections.
namespace tarsier::face::people {

struct Person {
  std::int64_t id = 0;
  std::string name;
  std::string note;       // consent: who agreed to what, when
  std::int64_t time = 0;  // of enrolment, ms since 1970-01-01 UTC
  std::int64_t faces = 0;
};

// A face that is enrolled or will be enrolled.
struct StoredFace {
  std::int64_t id = 0;
  std::int64_t person = 0;
  cv::Mat crop;                 // CV_8UC1, as from crop_face()
  std::vector<float> features;  // the template; empty: not computed yet
  std::int64_t space = 0;       // of the template, see StoredModel; 0: no template
  double quality = 0;           // 0..1
  std::string measures;         // JSON object of the quality measures
  std::string source;           // file or camera, passwords masked
  std::int64_t time = 0;        // ms since 1970-01-01 UTC
};

struct FaceRef {
  std::int64_t id = 0;
  std::int64_t person = 0;
};

// A face with the person it shows.
struct NewFace {
  std::string name;
  std::string note;
  StoredFace face;
};

// The trained model. Each template belongs to a space: that of a model (its id, > 0), or of
// coordinates in the directions of a background (minus its fingerprint, < 0). Coordinates do not
// depend on the enrolled people.
struct StoredModel {
  std::int64_t id = 0;
  std::int64_t generation = 0;  // of the gallery at training
  std::int64_t space = 0;       // its own id, or the coordinates it was trained on
  std::string body;
};

// A face of a sighting.
struct SightingFace {
  cv::Mat crop;          // CV_8UC1, as from crop_face()
  double quality = 0;    // 0..1
  std::string measures;  // JSON object of the quality measures
};

struct Sighting {
  std::int64_t id = 0;
  std::int64_t time = 0;  // ms since 1970-01-01 UTC
  std::string source;
  std::string name;  // of the nearest person; empty: similar to nobody
  bool known = false;
  double confidence = 0;   // 0..1
  bool has_face = false;   // its crop is stored
  double quality = 0;      // of the crop, 0..1
  std::int64_t group = 0;  // of an unknown face; 0: none
};

// Sightings of unknown faces that show the same person.
struct SightingGroup {
  std::int64_t id = 0;
  std::int64_t sightings = 0;
  std::int64_t first_time = 0;  // ms since 1970-01-01 UTC
  std::int64_t last_time = 0;
};

// A face that is known not to show a given person.
struct Negative {
  std::int64_t id = 0;
  std::int64_t person = 0;
  double quality = 0;     // 0..1
  std::string source;     // file or camera, passwords masked
  std::int64_t time = 0;  // ms since 1970-01-01 UTC
};

// A manual correction. Each is one transaction and can be undone by another correction.
struct Correction {
  std::int64_t id = 0;
  std::int64_t time = 0;  // ms since 1970-01-01 UTC
  std::string actor;      // who corrected
  // "name", "not", "move", "merge", "split", "merge groups", "split group", "undo"
  std::string kind;
  std::string from;  // person, or "group 3"; empty: none
  std::string to;
  std::int64_t count = 0;   // faces, sightings or negatives that were changed
  std::int64_t undone = 0;  // id of the correction that undid this one; 0: still valid
  std::int64_t undoes = 0;  // id of the correction that this one undoes; 0: none
};

// "group 3 is Ann (4), undone by 7": without time and actor.
[[nodiscard]] std::string text_of(const Correction& entry);

// Who corrects, and when; stored in the log.
struct CorrectionStamp {
  std::int64_t time = 0;  // ms since 1970-01-01 UTC
  std::string actor;
};

// What happened to a gallery's index (gallery_index.h) when a person was forgotten.
enum class IndexOutcome {
  kNone,       // there was none
  kKept,       // it contained none of the faces
  kRewritten,  // it was rewritten without them
  kDeleted,    // it was learned from them, or was not usable
};

// A template and the person it belongs to.
struct PersonTemplate {
  std::int64_t person = 0;
  std::int64_t face = 0;
  std::vector<float> numbers;
};

struct ForgetReport {
  Person person;            // with the number of removed faces; no name if all were forgotten
  std::int64_t people = 0;  // removed people
  std::int64_t sightings = 0;
  bool model_removed = false;        // the model was trained on these faces, so it was removed too
  std::int64_t total_pieces = 0;     // number of 32-byte pieces of the removed crops and templates
  std::int64_t searched_pieces = 0;  // pieces that were searched for
  // Pieces not searched for, because faces of other people contain them too.
  std::int64_t shared_pieces = 0;
  std::vector<std::string> shared_with;  // these other people
  // Number of removed crops and templates of which less than half of the pieces could be searched
  // for (the same image is enrolled under another name). Their removal is not proven.
  std::int64_t unproven_records = 0;
  IndexOutcome index = IndexOutcome::kNone;
  SearchReport search;
  bool gallery_searched = false;  // the gallery's own file was searched
  bool log_emptied = true;        // false: another program still reads the write-ahead log
  // True if pieces were searched for, everything in and below the folder could be searched, also
  // the gallery itself, and nothing was found. False if there was nothing to search for.
  [[nodiscard]] bool proven() const {
    return log_emptied && gallery_searched && searched_pieces > 0 && unproven_records == 0 &&
           search.files_with_pieces.empty() && search.unreadable.empty() && search.skipped.empty();
  }
};

// Committed data survives a crash; each face is one transaction. Errors as in media/sqlite.h.
// Malicious files give InputError or OutputError that names the path.
class Gallery {
 public:
  // Of a link, path() is the file that it leads to.
  explicit Gallery(const std::string& path, DatabaseAccess access = DatabaseAccess::kCreate,
                   int timeout_ms = 5000);

  [[nodiscard]] std::vector<Person> people();  // in order of enrolment
  [[nodiscard]] std::optional<Person> find(std::string_view name);
  // Finds or adds a person; a non-empty note replaces the old one. Throws UsageError (check_name).
  Person add_person(std::string_view name, std::string_view note, std::int64_t time);
  // Returns the id of the face. The crop is stored as PNG.
  std::int64_t add_face(const StoredFace& face);
  // Stores the person (added if new) and the face in one transaction.
  std::int64_t enroll(std::string_view name, std::string_view note, const StoredFace& face);
  // Several faces in one transaction.
  void enroll(std::span<const NewFace> faces);
  // Faces of one person or of all, one after the other in order of enrolment; without crops if
  // `crops` is false. The same object must not write to the gallery during the call.
  void each_face(std::optional<std::int64_t> person, bool crops,
                 const std::function<void(StoredFace&&)>& take);
  // All faces in one list. The crops of a large gallery do not fit into memory.
  [[nodiscard]] std::vector<StoredFace> faces(std::optional<std::int64_t> person = std::nullopt,
                                              bool crops = true);
  [[nodiscard]] std::optional<StoredFace> face(std::int64_t id);
  // All faces in order of enrolment; reads neither crops nor templates.
  [[nodiscard]] std::vector<FaceRef> face_refs();
  [[nodiscard]] std::int64_t face_count();
  // face_count(), but counting stops at `max_count`.
  [[nodiscard]] std::int64_t face_count_up_to(std::int64_t max_count);
  // The most recently enrolled face of a person.
  [[nodiscard]] std::optional<StoredFace> latest_face(std::int64_t person);

  // Removes the person with faces, templates, sightings and log entries, and also the model if it
  // was trained on one of these faces. Unknown faces whose nearest person this was stay. Frees the
  // space, empties the write-ahead log, then searches the files in and below the gallery's folder
  // for 32-byte pieces of the removed data. Empty if nobody has that name. Throws Interrupted
  // (during the search only).
  [[nodiscard]] std::optional<ForgetReport> forget(std::string_view name,
                                                   const std::stop_token& stop,
                                                   const SearchLimits& limits = {});
  // Whether log entries name a person who is not enrolled (any more).
  [[nodiscard]] bool is_in_log(std::string_view name);
  // Deletes these entries; returns how many.
  std::int64_t forget_in_log(std::string_view name);
  // Forgets everybody at once. Empty if nobody is enrolled.
  [[nodiscard]] std::optional<ForgetReport> forget_all(const std::stop_token& stop,
                                                       const SearchLimits& limits = {});

  // Forgets a group of unknown faces.
  [[nodiscard]] std::optional<ForgetReport> forget_group(std::int64_t group,
                                                         const std::stop_token& stop,
                                                         const SearchLimits& limits = {});

  // Changes with every enrolment, removal and training, by any program. Costs one look-up.
  [[nodiscard]] std::int64_t generation();
  // Changes with generation(), and when sightings are grouped or deleted.
  [[nodiscard]] std::int64_t group_generation();
  // Replaces the model, trained at generation `generation` on the faces `learned`. `space` 0: the
  // model has its own space, with these templates. Returns the model's id. Empty if one of the
  // faces was removed meanwhile; then nothing is stored.
  std::optional<std::int64_t> store_model(
      std::string_view body, std::int64_t generation, std::int64_t space,
      std::span<const std::int64_t> learned,
      std::span<const std::pair<std::int64_t, std::vector<float>>> templates);
  // The last trained model, even if the gallery has changed since.
  [[nodiscard]] std::optional<StoredModel> model();
  [[nodiscard]] std::int64_t model_id();          // 0: no model is stored
  [[nodiscard]] std::int64_t model_generation();  // -1: no model is stored
  // Stores templates by face id; those of removed faces are skipped.
  void store_templates(std::int64_t space,
                       std::span<const std::pair<std::int64_t, std::vector<float>>> templates);
  // Templates of a space, by rising face id.
  void each_template(std::int64_t space,
                     const std::function<void(std::int64_t face, std::span<const float>)>& take);
  [[nodiscard]] std::vector<float> template_of(std::int64_t face, std::int64_t space);  // or empty
  // Faces without a template in this space, by rising id.
  [[nodiscard]] std::vector<std::int64_t> without_template(std::int64_t space);
  // gallery_lookup.cpp: queries for the gallery's index (gallery_index.h).
  [[nodiscard]] std::int64_t last_face();  // the greatest id; 0: no faces
  [[nodiscard]] std::int64_t people_with_faces();
  // Number of templates in a space with face ids up to `last` and greater than `after`.
  [[nodiscard]] std::int64_t template_count(std::int64_t space, std::int64_t last,
                                            std::int64_t after = 0);
  // At most `max_count` of these, by rising id. A large gallery is read in pieces, so that other
  // programs can empty its write-ahead log in between.
  void each_template_after(
      std::int64_t space, std::int64_t after, std::int64_t last, std::int64_t max_count,
      const std::function<void(std::int64_t face, std::span<const float>)>& take);
  // All templates of the people who have one of these faces.
  [[nodiscard]] std::vector<PersonTemplate> templates_of_same_people(
      std::span<const std::int64_t> faces, std::int64_t space);
  [[nodiscard]] std::string name_of(std::int64_t person);  // empty: the person was removed
  [[nodiscard]] std::int64_t removals();  // number of removals of enrolled faces; rises
  // Whether an index with this SHA-256 is the current index of the gallery.
  [[nodiscard]] bool is_index(std::string_view sha256);
  // The SHA-256 of the valid indexes; empty: there is none.
  [[nodiscard]] std::string index_record();
  // Faces with ids greater than `after` without a template in this space, by rising id.
  [[nodiscard]] std::vector<std::int64_t> without_template_after(std::int64_t space,
                                                                 std::int64_t after);
  // Makes an index of the templates of `model` the gallery's index; `put` moves the file into
  // place. Returns false and does nothing if faces were removed since `removals` or the model has
  // changed. After an interruption, either the old or the new index is valid.
  bool put_index(std::int64_t removals, std::int64_t model, std::string_view sha256,
                 const std::function<void()>& put);

  // "default" if not set.
  [[nodiscard]] std::string algorithm();
  void set_algorithm(std::string_view name);
  // The user's own network that computes the templates, "SHA256 NAME" of its file; empty: none.
  [[nodiscard]] std::string network();
  void set_network(std::string_view network);

  // Returns the id of the sighting. Empty `name`: similar to nobody. If nobody has that name (any
  // more), returns 0 and stores nothing. `face` may be null; then no crop is stored.
  std::int64_t add_sighting(std::int64_t time, std::string_view source, std::string_view name,
                            bool known, double confidence, const SightingFace* face = nullptr);
  // Stores a better image of the same face. False if the sighting was removed or is already in a
  // group.
  bool improve_sighting(std::int64_t id, const SightingFace& face);
  // Newest first, at most `limit` (0: all).
  [[nodiscard]] std::vector<Sighting> sightings(std::int64_t limit = 0);
  [[nodiscard]] std::optional<Sighting> sighting(std::int64_t id);
  [[nodiscard]] std::int64_t sighting_count();
  [[nodiscard]] std::optional<SightingFace> sighting_face(std::int64_t id);
  // gallery_groups.cpp
  [[nodiscard]] std::vector<SightingGroup> groups();
  [[nodiscard]] std::optional<SightingGroup> group(std::int64_t id);
  [[nodiscard]] std::vector<Sighting> group_sightings(std::int64_t group);  // in order of their ids
  // Unknown faces that are not in a group yet, in order.
  [[nodiscard]] std::vector<std::int64_t> ungrouped();
  [[nodiscard]] std::int64_t ungrouped_count();
  // Coordinates of an unknown face in a space (< 0, as for templates); empty if not computed yet.
  [[nodiscard]] std::vector<float> sighting_coordinates(std::int64_t sighting, std::int64_t space);
  void store_sighting_coordinates(
      std::int64_t space, std::span<const std::pair<std::int64_t, std::vector<float>>> numbers);
  // Each sighting that is in a group, in order.
  void each_grouped(
      const std::function<void(std::int64_t sighting, std::int64_t group, double quality)>& take);
  // Pairs of groups that show different people; each pair once.
  [[nodiscard]] std::vector<std::pair<std::int64_t, std::int64_t>> cannot_link_pairs();
  [[nodiscard]] std::int64_t next_group();
  // The result of placing a sighting, see SightingGroups.
  struct SightingAssignment {
    std::int64_t sighting = 0;
    std::int64_t group = 0;
    std::vector<std::pair<std::int64_t, std::int64_t>> merged;
  };
  // Stores placements and the id of the next group in one transaction. Returns false and stores
  // nothing if groups or sightings have changed since group_generation() was `generation`.
  // Otherwise it is then `generation` + 1.
  bool store_assignments(std::span<const SightingAssignment> assignments, std::int64_t next,
                         std::int64_t generation);
  // Merges groups that show the same person, in this order: the first of each pair into the second.
  // One transaction; otherwise as store_assignments().
  bool store_merges(std::span<const std::pair<std::int64_t, std::int64_t>> groups,
                    std::int64_t generation);

  // gallery_corrections.cpp. Each returns the id of its log entry. Throws InputError, which says
  // what to do, for ids, names and groups that do not exist or cannot be changed in this way, and
  // UsageError for invalid new names (check_name). On an error nothing is changed.
  // Identifies a group of unknown faces as a person. Enrols the best `max_faces` faces and assigns
  // the group's sightings to the person.
  std::int64_t name_group(std::int64_t group, std::string_view name, std::string_view note,
                          std::int64_t max_faces, const CorrectionStamp& stamp);
  // An enrolled face, or a sighting, does not show the person it is assigned to. It becomes a
  // negative of that person. It is deleted with its sighting (retention, forget_group()), and
  // overruled when the same face is given to the person again.
  std::int64_t not_this_face(std::int64_t face, const CorrectionStamp& stamp);
  std::int64_t not_this_sighting(std::int64_t sighting, const CorrectionStamp& stamp);
  // A face that is currently visible, and was never stored, does not show this person.
  std::int64_t not_this_person(std::string_view name, const SightingFace& face,
                               std::string_view source, const CorrectionStamp& stamp);
  // Moves faces of one person to another, who is added if new.
  std::int64_t move_faces(std::span<const std::int64_t> faces, std::string_view to,
                          const CorrectionStamp& stamp);
  // Moves some faces of a person to a new person.
  std::int64_t split_person(std::string_view name, std::span<const std::int64_t> faces,
                            std::string_view to, const CorrectionStamp& stamp);
  // Merges two names of the same person; the first name is removed.
  std::int64_t merge_people(std::string_view from, std::string_view into,
                            const CorrectionStamp& stamp);
  std::int64_t merge_groups(std::int64_t from, std::int64_t into, const CorrectionStamp& stamp);
  // Moves sightings of a group that show another person to a group of their own. The two groups are
  // kept apart.
  std::int64_t split_group(std::int64_t group, std::span<const std::int64_t> sightings,
                           const CorrectionStamp& stamp);
  // Undoes a correction, or the last valid one (id 0). Does not restore what retention or `forget`
  // has removed.
  std::int64_t undo(std::int64_t id, const CorrectionStamp& stamp);
  // Newest first, at most `limit` (0: all).
  [[nodiscard]] std::vector<Correction> corrections(std::int64_t limit = 0);
  [[nodiscard]] std::optional<Correction> correction(std::int64_t id);
  // Without those that a later correction overruled.
  [[nodiscard]] std::vector<Negative> negatives();
  [[nodiscard]] std::vector<Negative> overruled_negatives();
  [[nodiscard]] cv::Mat negative_crop(std::int64_t id);  // empty if it was removed

  // Deletes the sightings before `time` (ms), at most `max_count`; returns how many. Each
  // transaction deletes a few hundred, so that other programs can write in between.
  std::int64_t forget_sightings_before(
      std::int64_t time, std::int64_t max_count = std::numeric_limits<std::int64_t>::max());

  [[nodiscard]] const std::string& path() const { return database_.path(); }

 private:
  [[nodiscard]] std::string setting(const char* name);  // empty: not set
  void set_setting(const char* name, std::string_view value);
  void put_setting(const char* name, std::string_view value);
  void increment_removals();
  void increment_generation();
  void drop_model();
  [[nodiscard]] StoredFace face_at(const Statement& row, bool crops) const;
  enum class ForgetScope { kPerson, kGroup, kAll };
  std::optional<ForgetReport> forget_matching(ForgetScope what, std::int64_t id,
                                              const std::stop_token& stop,
                                              const SearchLimits& limits);
  // `condition` has one parameter.
  void each_stored_face_data(
      const std::string& condition, std::int64_t value,
      const std::function<void(std::int64_t owner, std::span<const std::uint8_t>)>& take);
  void drop_empty_groups();
  void set_next_group(std::int64_t id);
  void increment_group_changes();
  void join_groups(std::int64_t from, std::int64_t into);
  [[nodiscard]] Person require_person(std::string_view name);
  struct CorrectionRecord;
  std::int64_t write_correction(const CorrectionRecord& record, const CorrectionStamp& stamp);
  void write_change(std::int64_t correction, std::string_view kind, std::int64_t row,
                    std::int64_t before);
  std::int64_t add_negative(std::int64_t person, const std::vector<std::uint8_t>& png,
                            double quality, std::string_view measures, std::string_view source,
                            std::int64_t time, std::int64_t sighting);
  void overrule_negatives(std::int64_t person, std::int64_t correction);
  std::int64_t reassign_faces(std::string_view kind, std::span<const std::int64_t> faces,
                              const Person& from, std::string_view to,
                              const CorrectionStamp& stamp);
  void revert(const CorrectionRecord& record);
  void restore_apart(std::int64_t group, std::int64_t other);
  void restore_face(std::int64_t face, std::int64_t negative);
  std::int64_t remove_log_entries(std::int64_t person, std::string_view name);
  void remove_undo_entries();
  [[nodiscard]] bool shrink_file();
  Database database_;
};

}  // namespace tarsier::face::people
