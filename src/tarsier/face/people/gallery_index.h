// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/face/people/gallery.h"
#include "tarsier/face/people/model.h"
#include "tarsier/face/recognition/background_space.h"
#include "tarsier/face/recognition/cell_index.h"
#include "tarsier/face/recognition/recognizer.h"

#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

// The index of a large gallery: a file in the same folder (recognition/cell_index.h) that returns
// candidates for a face. The person of each candidate is looked up in the gallery and compared
// exactly, with all templates of that person, as in an exact search. An index can therefore miss a
// person, but cannot return someone who is not enrolled.
//
// The gallery stores the SHA-256 of its index. An index file of another state or another gallery,
// or a modified one, is not used. Faces that were enrolled after the index was built are compared
// exactly. Templates of another model make the index unusable: `people index` builds a new one.
namespace tarsier::face::people {

// Below this number of faces an exact search is as fast (docs/results.md, large galleries).
inline constexpr std::int64_t kMinFacesForIndex = 20'000;
// Number of cells to search, and number of candidates whose people are compared exactly.
inline constexpr int kIndexProbes = 64;
inline constexpr int kIndexCandidates = 32;

[[nodiscard]] std::string index_path(const Gallery& gallery);

struct GalleryIndexReport {
  recognition::CellIndexReport index;
  std::int64_t faces = 0;  // of the gallery, when the build started
  std::string path;
};

// Builds a new index of a gallery and replaces the old one, which is used until then. An
// interruption at any time leaves either the old or the new index. Other programs may enrol and
// forget people meanwhile; the build restarts when a person is forgotten. Throws InputError if the
// gallery has no model yet or does not store coordinates (see model.h); OutputError, Interrupted.
// Stages of `progress` as in write_cell_index().
[[nodiscard]] GalleryIndexReport build_gallery_index(Gallery& gallery,
                                                     const recognition::Background& background,
                                                     const recognition::CellIndexOptions& options,
                                                     Progress& progress,
                                                     const std::stop_token& stop);

struct GalleryIndexState {
  bool exists = false;
  bool current = false;
  std::string unused_reason;  // why it is not used; empty if it is used or does not exist
  std::int64_t faces = 0;     // in the index
  std::int64_t newer = 0;     // enrolled after the index was built
};
// Needs no background. Also detects that its templates belong to a model that no longer exists.
[[nodiscard]] GalleryIndexState gallery_index_state(Gallery& gallery);

// Whether building a new index is worth its time: more than this number of faces are compared one
// by one.
[[nodiscard]] constexpr bool index_is_outdated(std::int64_t newer) {
  return newer > kMinFacesForIndex;
}

// A gallery that is searched through its index. The gallery must outlive it. Not thread-safe.
class GalleryIndex {
 public:
  // Null if no index can be used; `unused_reason` then says why in one line, or is empty if there
  // is no index file. `background` must outlive the object.
  [[nodiscard]] static std::unique_ptr<GalleryIndex> open(Gallery& gallery,
                                                          const recognition::Background& background,
                                                          const StoredModel& stored,
                                                          const recognition::Recognizer& subspace,
                                                          std::string& unused_reason);

  // Gives the same answer as recognize() of model.h if the right person is among the candidates.
  // The index of the nearest template is not set (-1). Throws InputError if the file is damaged.
  [[nodiscard]] Recognition recognize(std::span<const float> features, double false_accepts);
  // Call after changes of the gallery. False if the index is no longer valid.
  [[nodiscard]] bool update(const recognition::Recognizer& subspace);
  [[nodiscard]] std::int64_t newer() const { return static_cast<std::int64_t>(newer_.size()); }
  [[nodiscard]] const recognition::CellIndex& cells() const { return cells_; }

 private:
  GalleryIndex(Gallery& gallery, const recognition::Background& background,
               recognition::CellIndex cells, const recognition::Recognizer& subspace);
  void read_newer();
  void read_negatives();

  Gallery& gallery_;
  const recognition::Background& background_;
  recognition::CellIndex cells_;
  recognition::CoordinateProjection projection_;
  recognition::Recognizer candidates_;  // the subspace, and the people of the current probe
  std::int64_t people_ = 0;             // people who have faces
  std::vector<std::int64_t> newer_;     // faces, rising
  recognition::Rows newer_templates_;
  std::map<std::int64_t, std::pair<std::int64_t, std::vector<float>>> negatives_;  // id: person
};

// Used by Gallery::forget(), so that no index file contains a forgotten person. prepare() is called
// before the removal. It writes an index without the removed faces. It decides that the index must
// be deleted if it was learned from one of them, does not belong to the gallery, or is damaged.
// replace() moves the new index into place, within the transaction of the removal. finish()
// overwrites the old file with zeros. An index that is being built by another program is deleted.
class IndexRemoval {
 public:
  explicit IndexRemoval(Gallery& gallery);
  ~IndexRemoval();
  IndexRemoval(const IndexRemoval&) = delete;
  IndexRemoval& operator=(const IndexRemoval&) = delete;
  // `kept_faces`: rising ids of the faces that are kept. `model_removed`: the model is removed, so
  // the templates will change.
  void prepare(const std::function<std::vector<std::int64_t>()>& kept_faces, bool model_removed,
               const std::stop_token& stop);
  // Returns the SHA-256 of the gallery's new index; empty: there is none.
  [[nodiscard]] std::string replace(const std::string& recorded);
  void finish();
  [[nodiscard]] IndexOutcome outcome() const { return outcome_; }

 private:
  std::string path_;
  std::string prepared_;    // the file without the removed faces; empty: none
  std::string old_sha256_;  // SHA-256 of the index that it was written from
  std::string new_sha256_;
  int old_fd_ = -1;
  int unfinished_fd_ = -1;
  bool keep_index_ = false;
  IndexOutcome outcome_ = IndexOutcome::kNone;
};

}  // namespace tarsier::face::people
