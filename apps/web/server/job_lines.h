// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <string>
#include <string_view>

// The lines that jobs print, as they are kept.
namespace tarsier::web {

// Appends lines to a file up to a limit; what is more is left out, and a line says so. A disk that
// is full is warned of once.
class BoundedFile {
 public:
  BoundedFile() = default;
  ~BoundedFile() { close(); }
  BoundedFile(const BoundedFile&) = delete;
  BoundedFile& operator=(const BoundedFile&) = delete;
  void open(const std::string& path, std::uint64_t most, bool fresh);
  void add(std::string_view line);
  void close();

 private:
  int fd_ = -1;
  std::uint64_t written_ = 0;
  std::uint64_t most_ = 0;
};

// The last lines of a file.
[[nodiscard]] std::deque<std::string> tail_of(const std::string& path, std::size_t lines);

// A line whose long lists (all files that were searched) are cut, with their lengths beside them:
// lines.jsonl has it whole.
[[nodiscard]] std::string shortened(const std::string& line);

}  // namespace tarsier::web
