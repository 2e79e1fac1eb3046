// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace tarsier::web {

// The path of a request ("/a%20b?x=1"), decoded and checked. nullopt for "..", ".", empty segments,
// encoded '/', backslashes, control characters and invalid escapes.
struct Target {
  std::string path;
  std::string query;  // not decoded
};
[[nodiscard]] std::optional<Target> parse_target(std::string_view text);

// Parses "bytes=0-99", "bytes=100-" or "bytes=-5" for a file of `size` bytes to [first, last].
// nullopt for several ranges or invalid text; then the whole file is sent. `unsatisfiable`: status
// 416.
struct ByteRange {
  std::uint64_t first = 0;
  std::uint64_t last = 0;
};
[[nodiscard]] std::optional<ByteRange> parse_range(std::string_view text, std::uint64_t size,
                                                   bool& unsatisfiable);

}  // namespace tarsier::web
