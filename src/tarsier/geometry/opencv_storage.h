// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <map>
#include <string>
#include <string_view>

namespace tarsier::geometry {

// One top-level entry of a cv::FileStorage file, as text: "5", or its parts ("rows" "3", "data" "[
// 1., 2. ]").
struct StoredEntry {
  std::string text;
  std::map<std::string, std::string, std::less<>> parts;
};
using StoredEntries = std::map<std::string, StoredEntry, std::less<>>;

// Parses the top-level numbers, matrices and lists of numbers of a cv::FileStorage file in YAML
// ("%YAML...") or XML ("<?xml..."). Deeper entries are ignored. cv::FileStorage itself is not safe
// for untrusted files: OpenCV 4.6 crashes on truncated XML and does not limit nesting. Throws
// InputError(path) for another format, a truncated file or a duplicate entry.
[[nodiscard]] StoredEntries parse_opencv_storage(std::string_view text, const std::string& path);

}  // namespace tarsier::geometry
