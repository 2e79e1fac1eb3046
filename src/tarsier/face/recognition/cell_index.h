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

// Approximate nearest neighbours among millions of templates, in a file on disk. An inverted file
// (Sivic and Zisserman, "Video Google", 2003; Jegou, Douze and Schmid, "Product quantization for
// nearest neighbor search", 2011) with cells from k-means on directions (Dhillon and Modha, 2001).
// Templates are stored with 8 bits per number and one scale per template. A search reads the cells
// whose centres are most similar to the probe and returns candidates, which the caller compares
// exactly. File and results do not depend on the number of threads.
namespace tarsier::face::recognition {

struct CellIndexOptions {
  int cells = 0;        // 0: chosen by the number of templates, see cells_for()
  int learn_from = 32;  // templates per cell for training the centres
  int rounds = 8;       // iterations of k-means
  // Memory for the templates that are written in one pass over all templates.
  double memory_gb = 3;

  [[nodiscard]] OptionFields fields() {
    return {{"cells", cells, range(0, 65536), "--cells",
             "cells of the index; 0: by the number of templates"},
            {"learn_from", learn_from, range(1, 1000)},
            {"rounds", rounds, range(1, 100)},
            {"memory_gb", memory_gb, range(0.01, 1000), "--memory",
             "GB of memory for the templates; less memory takes more passes"}};
  }
  void check() const { check_fields(*this); }
};

// Powers of two, about 2 sqrt(templates) to 4 sqrt(templates), 16 to 65536.
[[nodiscard]] int cells_for(std::int64_t templates);

// Enumerates templates by rising id, identically at each call. Calls take(ids, rows) for some
// thousand templates at a time. With `step`, only every step-th template, starting with the first.
using TemplateSource = std::function<void(
    std::int64_t step,
    const std::function<void(std::span<const std::int64_t> ids, const Rows& rows)>& take)>;

// Metadata that the writer of an index stores in it.
struct CellIndexMetadata {
  // All templates with ids up to this one that existed are in the index.
  std::int64_t last_id = 0;
  std::int64_t space = 0;  // of the templates, see people/gallery.h
  std::int64_t model = 0;
};

struct CellIndexReport {
  std::string sha256;  // SHA-256 of the head, which contains a checksum of each cell
  std::int64_t templates = 0;
  int cells = 0;
  int passes = 0;  // passes over the templates for writing
  std::int64_t bytes = 0;
};

// Writes an index of `count` templates of `dimension` numbers to `path`, replacing the file. The
// file is synced to disk before the function returns. The head is written last, so that an
// interrupted write leaves no valid index. Stages of `progress`: "learning cells", "assigning",
// "writing". Throws OutputError, Interrupted, what the source throws, and std::invalid_argument if
// the source gives different templates at each call.
[[nodiscard]] CellIndexReport write_cell_index(const std::string& path, int dimension,
                                               std::int64_t count, const TemplateSource& source,
                                               const CellIndexMetadata& metadata,
                                               const CellIndexOptions& options, Progress& progress,
                                               const std::stop_token& stop);

struct Candidate {
  std::int64_t id = 0;
  float score = 0;  // approximates the dot product
};

// An index on disk. Its head is in memory (some MB for 10 million templates). Cells are read from
// the file when a search needs them, and then stay in the system's cache. Const functions are
// thread-safe.
class CellIndex {
 public:
  // Checks the head against its SHA-256, and each number in it against the file's size, before
  // using it. Throws InputError(path).
  explicit CellIndex(std::string path);
  ~CellIndex();
  CellIndex(CellIndex&& other) noexcept;
  CellIndex& operator=(CellIndex&&) = delete;

  [[nodiscard]] const CellIndexMetadata& metadata() const { return metadata_; }
  [[nodiscard]] const std::string& sha256() const { return sha256_; }
  [[nodiscard]] std::int64_t templates() const { return templates_; }
  [[nodiscard]] int dimension() const { return dimension_; }
  [[nodiscard]] int cells() const { return static_cast<int>(cells_.size()); }
  [[nodiscard]] const std::string& path() const { return path_; }
  // Ids of the templates from which the centres were learned, rising.
  [[nodiscard]] const std::vector<std::int64_t>& learned_from() const { return learned_from_; }

  // At most `count` templates from the `probes` nearest cells, best first; equal scores by rising
  // id. A cell's checksum is verified when it is first read: throws InputError(path) if it is
  // damaged.
  [[nodiscard]] std::vector<Candidate> search(std::span<const float> probe, int probes,
                                              int count) const;
  // Calls take() with the ids of each cell in turn; verifies each cell's checksum. Throws
  // InputError, Interrupted. Stage of `progress`: "reading".
  void each_cell(const std::function<void(std::span<const std::int64_t> ids)>& take,
                 Progress& progress, const std::stop_token& stop) const;
  // Writes the index without those templates for which `is_kept` is false. Throws as
  // write_cell_index(), and std::invalid_argument if the centres were learned from one of them.
  [[nodiscard]] CellIndexReport write_without(const std::string& path,
                                              const std::function<bool(std::int64_t id)>& is_kept,
                                              const std::stop_token& stop) const;

 private:
  struct Cell {
    std::int64_t offset = 0;  // in the file
    std::int64_t count = 0;
    std::uint64_t checksum = 0;
  };
  friend class CellIndexWriter;
  void read_head();
  void read_cell(std::size_t cell, std::vector<std::uint8_t>& block) const;

  std::string path_;
  int fd_ = -1;
  CellIndexMetadata metadata_;
  std::string sha256_;
  std::int64_t templates_ = 0;
  int dimension_ = 0;
  std::vector<std::int8_t> centres_;  // `stride` each
  std::vector<float> centre_scales_;
  Rows exact_centres_;
  std::vector<Cell> cells_;
  std::vector<std::int64_t> learned_from_;
  mutable std::unique_ptr<std::atomic<bool>[]> verified_;  // cells whose checksum was verified
};

}  // namespace tarsier::face::recognition
