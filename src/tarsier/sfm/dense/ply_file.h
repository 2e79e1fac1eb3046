// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <istream>
#include <string>
#include <string_view>
#include <vector>

// Binary little endian PLY files (Turk, "The PLY polygon file format", 1994): the header and the
// numbers in records.
namespace tarsier::sfm {

// The format of a number in a file.
struct PlyType {
  std::size_t bytes = 0;  // 0: unknown type
  double (*read)(const char* bytes) = nullptr;

  [[nodiscard]] bool is_known() const { return bytes > 0; }
};

struct PlyProperty {
  std::string name;
  PlyType type;   // of the number, or of the items of a list
  PlyType count;  // for a list: type of its item count, which comes first; otherwise unknown
  std::size_t offset = 0;  // bytes from the begin of the record, where no list precedes

  [[nodiscard]] bool is_list() const { return count.is_known(); }
};

struct PlyElement {
  std::string name;
  std::int64_t count = 0;
  std::vector<PlyProperty> properties;
  std::size_t bytes = 0;  // of a record without lists

  [[nodiscard]] bool has_lists() const;
  [[nodiscard]] const PlyProperty* find(std::string_view property) const;  // nullptr: none
};

// Reads up to the line end_header. `path` appears in errors. Throws InputError: a missing file, a
// text or big endian file, an unknown type, no count, more than 200 lines, vertices with lists. The
// first element is called vertex.
[[nodiscard]] std::vector<PlyElement> read_ply_header(std::istream& stream,
                                                      const std::string& path);

}  // namespace tarsier::sfm
