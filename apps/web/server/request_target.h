// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace tarsier::web {

// A path as it stands in the request ("/a%20b?x=1"), decoded and checked: nothing for "..", ".",
// empty segments, encoded '/', backslashes, control characters and broken escapes.
struct Target {
  std::string path;
  std::string query;  // as it stands
};
[[nodiscard]] std::optional<Target> parse_target(std::string_view text);

// "bytes=0-99", "bytes=100-" or "bytes=-5" of a file of `size` bytes as [first, last]; nothing for
// several ranges or nonsense, which are answered with the whole file. `unsatisfiable`: 416.
struct ByteRange {
  std::uint64_t first = 0;
  std::uint64_t last = 0;
};
[[nodiscard]] std::optional<ByteRange> parse_range(std::string_view text, std::uint64_t size,
                                                   bool& unsatisfiable);

}  // namespace tarsier::web
