// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/recognition/subspace.h"

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

// Approximate nearest neighbours among very many templates, from a file that stays on the disk: an
// inverted file (Sivic and Zisserman, "Video Google", 2003; Jegou, Douze and Schmid, "Product
// quantization for nearest neighbor search", 2011) whose cells come from k-means on directions
// (Dhillon and Modha, 2001), and whose numbers are kept in 8 bits, a scale for each template. A
// search looks into the cells whose centres are most like the probe, and gives candidates that the
// caller compares exactly. Same templates, same file and same answers, for any number of threads.
namespace tarsier::face::recognition {

struct CellIndexOptions {
  int cells = 0;         // 0: by the number of templates, see cells_for()
  int learn_from = 32;   // templates for each cell that the centres are learned from
  int rounds = 8;        // of k-means
  double memory_gb = 3;  // for the templates that are written in one pass over them all

  [[nodiscard]] OptionFields fields() {
    return {{"cells", cells, range(0, 65536), "--cells",
             "parts that the templates are divided into; 0: by their number"},
            {"learn_from", learn_from, range(1, 1000)},
            {"rounds", rounds, range(1, 100)},
            {"memory_gb", memory_gb, range(0.01, 1000), "--memory",
             "GB for the templates of one pass: with less there are more passes"}};
  }
  void check() const { check_fields(*this); }
};

// Powers of two, about 2 sqrt(templates) to 4 sqrt(templates), 16 to 65536.
[[nodiscard]] int cells_for(std::int64_t templates);

// Templates by rising id, the same at each call. Calls take(ids, rows) for some thousands at a
// time; with `step` for each step-th template alone, from the first on.
using TemplateSource = std::function<void(
    std::int64_t step,
    const std::function<void(std::span<const std::int64_t> ids, const Rows& rows)>& take)>;

// What whoever writes an index says of it.
struct CellIndexLabel {
  std::int64_t last = 0;   // ids up to this one are in it, where they were there
  std::int64_t space = 0;  // of the templates, see people/gallery.h
  std::int64_t model = 0;
};

struct CellIndexReport {
  std::string sum;  // SHA-256 of its head, in which there is a sum of each cell
  std::int64_t templates = 0;
  int cells = 0;
  int passes = 0;  // over the templates, to write them
  std::int64_t bytes = 0;
};

// Writes an index of `count` templates of `dimension` numbers to `path`, which is replaced, and
// safe on the disk at the return. The head is written last: what a kill leaves is no index. Stages
// of `progress`: "learning cells", "assigning", "writing". Throws OutputError, Interrupted, what
// the source throws, and std::invalid_argument where that gives other templates at each call.
[[nodiscard]] CellIndexReport write_cell_index(const std::string& path, int dimension,
                                               std::int64_t count, const TemplateSource& source,
                                               const CellIndexLabel& label,
                                               const CellIndexOptions& options, Progress& progress,
                                               const std::stop_token& stop);

struct Candidate {
  std::int64_t id = 0;
  float score = 0;  // about the dot product
};

// An index on the disk. Its head is in memory (of 10 million templates some MB); cells are read
// from the file when they are looked into, and are in the system's cache from then on. Const
// functions may be called by any number of threads.
class CellIndex {
 public:
  // The head is held against its SHA-256, and each number in it against the file's size, before
  // anything is used. Throws InputError(path).
  explicit CellIndex(const std::string& path);
  ~CellIndex();
  CellIndex(CellIndex&& other) noexcept;
  CellIndex& operator=(CellIndex&&) = delete;

  [[nodiscard]] const CellIndexLabel& label() const { return label_; }
  [[nodiscard]] const std::string& sum() const { return sum_; }
  [[nodiscard]] std::int64_t templates() const { return templates_; }
  [[nodiscard]] int dimension() const { return dimension_; }
  [[nodiscard]] int cells() const { return static_cast<int>(cells_.size()); }
  [[nodiscard]] const std::string& path() const { return path_; }
  // Of the templates that the centres were learned from, rising.
  [[nodiscard]] const std::vector<std::int64_t>& learned_from() const { return learned_from_; }

  // At most `count` of the templates in the `probes` nearest cells, best first, of equals the one
  // with the lower id. A cell is held against its sum when it is first read: InputError(path) where
  // it is damaged.
  [[nodiscard]] std::vector<Candidate> search(std::span<const float> probe, int probes,
                                              int count) const;
  // The ids of each cell, in turn; every cell is held against its sum. Throws InputError,
  // Interrupted. Stage of `progress`: "reading".
  void each_cell(const std::function<void(std::span<const std::int64_t> ids)>& take,
                 Progress& progress, const std::stop_token& stop) const;
  // Writes the index without those templates that `stays` denies. Throws as write_cell_index();
  // std::invalid_argument where the centres were learned from one of them.
  [[nodiscard]] CellIndexReport write_without(const std::string& path,
                                              const std::function<bool(std::int64_t id)>& stays,
                                              const std::stop_token& stop) const;

 private:
  struct Cell {
    std::int64_t offset = 0;  // in the file
    std::int64_t count = 0;
    std::uint64_t sum = 0;
  };
  friend class CellIndexWriter;
  void read_head();
  void read_cell(std::size_t cell, std::vector<std::uint8_t>& block) const;

  std::string path_;
  int fd_ = -1;
  CellIndexLabel label_;
  std::string sum_;
  std::int64_t templates_ = 0;
  int dimension_ = 0;
  std::vector<std::int8_t> centres_;  // `stride` each
  std::vector<float> centre_scales_;
  Rows exact_centres_;
  std::vector<Cell> cells_;
  std::vector<std::int64_t> learned_from_;
  mutable std::unique_ptr<std::atomic<bool>[]> seen_;  // cells whose sum is right
};

}  // namespace tarsier::face::recognition
