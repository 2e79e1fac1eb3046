// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

// Proof that bytes are gone: what was deleted is looked for in the files that are left.
namespace tarsier::face::people {

inline constexpr std::size_t kPiece = 32;  // bytes
// Of more pieces than this an even choice is looked for: memory stays bounded.
inline constexpr std::size_t kMaxPieces = 4'000'000;

// All runs of 32 bytes of what was deleted. Runs of fewer than 8 different bytes say nothing and do
// not count.
class Pieces {
 public:
  // `expected_bytes`: that are going to be added in all, where it may be more than `max_pieces`.
  explicit Pieces(std::int64_t expected_bytes = 0, std::size_t max_pieces = kMaxPieces);
  void add(std::span<const std::uint8_t> bytes);
  // Runs that are also in what stays are no trace. Returns how many these were. Takes time by the
  // size of `bytes` alone.
  std::size_t keep(std::span<const std::uint8_t> bytes);
  // That are looked for.
  [[nodiscard]] std::size_t count() const { return count_; }
  // That were added, also those that are not looked for.
  [[nodiscard]] std::int64_t total() const { return total_; }
  // That keep() took out.
  [[nodiscard]] std::size_t kept() const { return kept_; }
  // Of what was added (each add() by itself) so many have less than half of their pieces left, or
  // never had any: nothing can be proven of them.
  [[nodiscard]] std::size_t unproven_sources() const;
  // Whether `bytes` hold one of them.
  [[nodiscard]] bool in(std::span<const std::uint8_t> bytes) const;

 private:
  struct Source {
    std::size_t begin = 0;  // in data_
    std::size_t end = 0;
    std::size_t pieces = 0;  // when it was added
  };
  struct Entry {
    std::uint32_t hash = 0;
    std::uint32_t place = 0;  // in data_
  };
  void build() const;
  // Calls take(place) for each piece in `bytes`, some more than once; stops where it returns true.
  template <typename Take>
  bool each_piece(std::span<const std::uint8_t> bytes, const Take& take) const;

  std::size_t stride_ = 1;
  std::int64_t total_ = 0;
  std::size_t count_ = 0;
  std::size_t kept_ = 0;
  std::vector<std::uint8_t> data_;
  std::vector<bool> active_;  // of each byte of data_: a piece begins here
  std::vector<Source> sources_;
  mutable std::vector<Entry> index_;  // of parts of 24 bytes, sorted by hash
  mutable std::vector<std::uint64_t> filter_;
  mutable int filter_bits_ = 0;
  mutable bool built_ = true;
};

// How far below a folder is searched.
struct SearchLimits {
  int max_depth = 16;  // of folders in folders
  std::int64_t max_files = 50'000;
  std::int64_t max_bytes = std::int64_t{64} * 1024 * 1024 * 1024;
};

struct SearchReport {
  std::vector<std::string> files;  // searched: those of the folder, then of those below it
  std::int64_t folders = 0;        // that were looked into
  std::int64_t bytes = 0;
  std::int64_t links = 0;            // symbolic links: not followed
  std::vector<std::string> found;    // files that still hold a piece
  std::vector<std::string> unread;   // files and folders that could not be read
  std::vector<std::string> skipped;  // "path: why": other file systems, too deep, too much
};

// Searches every regular file of a folder and of the folders in it, breadth first, in the order of
// the names. Links are not followed, other file systems not entered. Throws Interrupted; InputError
// where the folder itself cannot be listed.
[[nodiscard]] SearchReport search_below(const Pieces& pieces, const std::string& folder,
                                        const std::stop_token& stop,
                                        const SearchLimits& limits = {});
// Which of these files hold a piece; `unread` gets those that cannot be read. Throws Interrupted.
[[nodiscard]] std::vector<std::string> search_files(const Pieces& pieces,
                                                    const std::vector<std::string>& files,
                                                    std::vector<std::string>& unread,
                                                    std::int64_t& bytes,
                                                    const std::stop_token& stop);

}  // namespace tarsier::face::people
