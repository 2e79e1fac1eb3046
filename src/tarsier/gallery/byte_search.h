// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

// Proof that bytes are gone: what was deleted is looked for in the files that are left.
namespace tarsier::people {

inline constexpr std::size_t kPiece = 32;  // bytes

// All runs of 32 bytes of what was deleted. Runs of fewer than 8 different bytes say nothing and do
// not count.
class Pieces {
 public:
  void add(std::span<const std::uint8_t> bytes);
  // Runs that are also in what stays are no trace.
  void keep(std::span<const std::uint8_t> bytes);
  [[nodiscard]] std::size_t count() const;
  // Whether `bytes` hold one of them.
  [[nodiscard]] bool in(std::span<const std::uint8_t> bytes) const;

 private:
  void sort() const;
  std::vector<std::vector<std::uint8_t>> sources_;
  struct Place {
    std::uint64_t hash = 0;
    std::uint32_t source = 0;
    std::uint32_t offset = 0;
  };
  mutable std::vector<Place> places_;  // sorted by hash
  mutable std::vector<bool> filter_;   // by the hash's low bits
  mutable bool sorted_ = true;
};

struct SearchReport {
  std::vector<std::string> files;  // searched, in order of their names
  std::int64_t bytes = 0;
  std::size_t pieces = 0;           // that were looked for
  std::vector<std::string> found;   // files that still hold one
  std::vector<std::string> unread;  // that could not be read
};

// Searches every regular file of a folder, not those of folders in it. Throws Interrupted;
// InputError where the folder cannot be listed.
[[nodiscard]] SearchReport search_folder(const Pieces& pieces, const std::string& folder,
                                         const std::stop_token& stop);

}  // namespace tarsier::people
