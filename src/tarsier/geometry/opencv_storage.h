// SPDX-License-Identifier: MIT
#pragma once

#include <functional>
#include <map>
#include <string>
#include <string_view>

namespace tarsier::geometry {

// One top entry of a file of cv::FileStorage, as text: "5", or its parts ("rows" "3", "data"
// "[ 1., 2. ]").
struct StoredEntry {
  std::string text;
  std::map<std::string, std::string, std::less<>> parts;
};
using StoredEntries = std::map<std::string, StoredEntry, std::less<>>;

// The numbers, matrices and lists of numbers among the top entries of YAML ("%YAML...") or XML
// ("<?xml...") of cv::FileStorage; what is nested deeper is passed over. cv::FileStorage itself is
// no reader for files from anywhere: OpenCV 4.6 crashes on XML that is cut short and has no bound
// on nesting. Throws InputError(path): no such text, cut short, an entry that is there twice.
[[nodiscard]] StoredEntries parse_opencv_storage(std::string_view text, const std::string& path);

}  // namespace tarsier::geometry
