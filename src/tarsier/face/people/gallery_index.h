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

// The index of a large gallery: a file beside it (recognition/cell_index.h) that gives candidates
// for a face. The answer is always made of the gallery's own rows: each candidate's person is looked
// up and compared exactly, with all their templates, as an exact search compares them. So an index
// can miss somebody, and cannot name anybody who is not enrolled.
//
// The gallery knows the SHA-256 of its index: a file of another state, of another gallery, or one
// that was changed, is not used. Faces that were enrolled since the index was made are compared
// exactly beside it. Templates that are of another model make it useless: `people index` makes
// another.
namespace tarsier::face::people {

// Below so many faces an exact search is as fast (docs/results.md, large galleries).
inline constexpr std::int64_t kWorthIndexing = 20'000;
// Cells that are looked into, and candidates of which the people are compared exactly.
inline constexpr int kIndexProbes = 64;
inline constexpr int kIndexCandidates = 32;

[[nodiscard]] std::string index_path(const Gallery& gallery);

struct GalleryIndexReport {
  recognition::CellIndexReport index;
  std::int64_t faces = 0;  // of the gallery, when it began
  std::string path;
};

// Makes the index of a gallery afresh, and puts it into its place: the old one is used until then,
// and a kill at any moment leaves the old one or the new one. Others may enrol and forget
// meanwhile; where somebody is forgotten it begins again. Throws InputError where the gallery has
// no model yet or does not keep coordinates (see model.h); OutputError, Interrupted. Stages of
// `progress` as write_cell_index().
[[nodiscard]] GalleryIndexReport build_gallery_index(Gallery& gallery,
                                                     const recognition::Background& background,
                                                     const recognition::CellIndexOptions& options,
                                                     Progress& progress,
                                                     const std::stop_token& stop);

struct GalleryIndexState {
  bool there = false;
  bool current = false;
  std::string trouble;     // why it is not used; empty where it is, or is not there
  std::int64_t faces = 0;  // in it
  std::int64_t newer = 0;  // enrolled since
};
// Without the background: whether its templates are those of a model that is gone is seen, too.
[[nodiscard]] GalleryIndexState gallery_index_state(Gallery& gallery);

// Whether another index is worth its time: more faces than these are compared one by one.
[[nodiscard]] constexpr bool index_is_behind(std::int64_t newer) { return newer > kWorthIndexing; }

// A gallery that is searched through its index. The gallery must outlive it. One thread at a time.
class GalleryIndex {
 public:
  // Null where no index can be used; `trouble` says why in one line, and is empty where there is no
  // index file. `background` must outlive it.
  [[nodiscard]] static std::unique_ptr<GalleryIndex> open(Gallery& gallery,
                                                          const recognition::Background& background,
                                                          const StoredModel& stored,
                                                          const recognition::Recognizer& subspace,
                                                          std::string& trouble);

  // The same answer as recognize() of model.h where the right person is among the candidates; of
  // the nearest template there is no index (-1). Throws InputError where the file is damaged.
  [[nodiscard]] Recognition recognize(std::span<const float> features, double false_accepts);
  // After changes of the gallery: false where the index is no longer the gallery's.
  [[nodiscard]] bool follow(const recognition::Recognizer& subspace);
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
  recognition::Recognizer candidates_;  // the subspace; the people of one question
  std::int64_t people_ = 0;             // who have faces
  std::vector<std::int64_t> newer_;     // faces, rising
  recognition::Rows newer_templates_;
  std::map<std::int64_t, std::pair<std::int64_t, std::vector<float>>> negatives_;  // id: person
};

// For Gallery::forget(): no index file may hold anybody who is forgotten when that is done.
// prepare() writes, before anything is removed, an index without those faces that do not stay, or
// finds that it must go: it was learned from one of them, it is not the gallery's or is damaged.
// replace() puts it into place, within the transaction that removes them; the old one's bytes are
// overwritten with zeros by finish(). An index that is being made is taken away from its maker.
class IndexRemoval {
 public:
  explicit IndexRemoval(Gallery& gallery);
  ~IndexRemoval();
  IndexRemoval(const IndexRemoval&) = delete;
  IndexRemoval& operator=(const IndexRemoval&) = delete;
  // `stays`: rising ids of the faces that stay. `model_goes`: the templates will be others.
  void prepare(const std::function<std::vector<std::int64_t>()>& stays, bool model_goes,
               const std::stop_token& stop);
  // Returns the sum of the index that is the gallery's from now on; empty: none is.
  [[nodiscard]] std::string replace(const std::string& recorded);
  void finish();
  [[nodiscard]] IndexFate fate() const { return fate_; }

 private:
  std::string path_;
  std::string prepared_;  // the file without them; empty: none
  std::string from_;      // sum of the index that it was made of
  std::string to_;
  int old_ = -1;
  int unfinished_ = -1;
  bool keep_ = false;
  IndexFate fate_ = IndexFate::kNone;
};

}  // namespace tarsier::face::people
