// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

// Proof of deletion: searches the remaining files for pieces of the deleted bytes.
namespace tarsier::face::people {

inline constexpr std::size_t kPieceBytes = 32;  // bytes
// If there are more pieces, an evenly chosen subset is searched for. This bounds the memory.
inline constexpr std::size_t kMaxPieces = 4'000'000;

// All 32-byte runs of the deleted data. Runs with fewer than 8 different bytes are not distinctive
// and are ignored.
class Pieces {
 public:
  // `expected_bytes`: total size that will be added, if that can exceed `max_pieces`.
  explicit Pieces(std::int64_t expected_bytes = 0, std::size_t max_pieces = kMaxPieces);
  void add(std::span<const std::uint8_t> bytes);
  // Removes the pieces that data which is kept also contains; they prove nothing. Returns their
  // number. The time depends on the size of `bytes` only.
  std::size_t exclude(std::span<const std::uint8_t> bytes);
  // Pieces that are searched for.
  [[nodiscard]] std::size_t count() const { return count_; }
  // Pieces that were added, including those that are not searched for.
  [[nodiscard]] std::int64_t total() const { return total_; }
  // Pieces that exclude() removed.
  [[nodiscard]] std::size_t excluded() const { return excluded_; }
  // Number of add() calls whose data have less than half of their pieces left, or never had any.
  // Their deletion cannot be proven.
  [[nodiscard]] std::size_t unproven_source_count() const;
  // Whether `bytes` contain a piece.
  [[nodiscard]] bool found_in(std::span<const std::uint8_t> bytes) const;

 private:
  struct Source {
    std::size_t begin = 0;  // in data_
    std::size_t end = 0;
    std::size_t pieces = 0;  // when added
  };
  struct Entry {
    std::uint32_t hash = 0;
    std::uint32_t offset = 0;  // in data_
  };
  void build() const;
  // Calls visit(offset) for each piece in `bytes`, for some more than once; stops when it returns
  // true.
  template <typename Visit>
  bool each_piece(std::span<const std::uint8_t> bytes, const Visit& visit) const;

  std::size_t stride_ = 1;
  std::int64_t total_ = 0;
  std::size_t count_ = 0;
  std::size_t excluded_ = 0;
  std::vector<std::uint8_t> data_;
  std::vector<bool> active_;  // for each byte of data_: a piece starts here
  std::vector<Source> sources_;
  mutable std::vector<Entry> index_;  // 24-byte parts, sorted by hash
  mutable std::vector<std::uint64_t> filter_;
  mutable int filter_bits_ = 0;
  mutable bool built_ = true;
};

// Limits of the search below a folder.
struct SearchLimits {
  int max_depth = 16;  // of nested folders
  std::int64_t max_files = 50'000;
  std::int64_t max_bytes = std::int64_t{64} * 1024 * 1024 * 1024;
};

struct SearchReport {
  std::vector<std::string> files;  // searched files: those of the folder first, then those below it
  std::int64_t folders = 0;        // searched folders
  std::int64_t bytes = 0;
  std::int64_t links = 0;                      // symbolic links, which are not followed
  std::vector<std::string> files_with_pieces;  // files that still contain a piece
  std::vector<std::string> unreadable;         // files and folders that could not be read
  std::vector<std::string> skipped;  // "path: why": other file systems, too deep, too much
};

// Searches every regular file of a folder and its subfolders, breadth first, in order of the names.
// Symbolic links are not followed, other file systems are not entered. Throws Interrupted;
// InputError if the folder itself cannot be listed.
[[nodiscard]] SearchReport search_below(const Pieces& pieces, const std::string& folder,
                                        const std::stop_token& stop,
                                        const SearchLimits& limits = {});
// Returns those files that contain a piece; `unreadable` receives those that cannot be read. Throws
// Interrupted.
[[nodiscard]] std::vector<std::string> search_files(const Pieces& pieces,
                                                    const std::vector<std::string>& files,
                                                    std::vector<std::string>& unreadable,
                                                    std::int64_t& bytes,
                                                    const std::stop_token& stop);

}  // namespace tarsier::face::people
