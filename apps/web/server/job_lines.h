// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <string>
#include <string_view>

// Storage of the lines that jobs print.
namespace tarsier::web {

// Appends lines to a file up to a size limit. Further lines are dropped, and a last line says so. A
// full disk gives one warning.
class BoundedFile {
 public:
  BoundedFile() = default;
  ~BoundedFile() { close(); }
  BoundedFile(const BoundedFile&) = delete;
  BoundedFile& operator=(const BoundedFile&) = delete;
  void open(const std::string& path, std::uint64_t max_bytes, bool truncate);
  void add(std::string_view line);
  void close();

 private:
  int fd_ = -1;
  std::uint64_t written_ = 0;
  std::uint64_t max_bytes_ = 0;
};

// The last lines of a file.
[[nodiscard]] std::deque<std::string> tail_of(const std::string& path, std::size_t lines);

// A line whose long lists (such as all searched files) are truncated, with their lengths added.
// lines.jsonl has the full line.
[[nodiscard]] std::string shortened(const std::string& line);

}  // namespace tarsier::web
