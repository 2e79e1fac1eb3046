// SPDX-License-Identifier: MIT
#pragma once

#include "framework/command_tree.h"
#include <string>
#include <vector>

namespace tarsier::cli {

struct ManualFile {
  std::string name;  // "tarsier-plate.1"
  std::string text;  // roff, man(7) macros
};

// The manual pages of the program, generated from its command tree: tarsier.1 and one for each
// area. `date` is copied unchanged (2026-01-31).
[[nodiscard]] std::vector<ManualFile> manual_pages(const std::vector<AreaInfo>& areas,
                                                   const std::string& date);

// A script for bash that completes areas, verbs, flags, values and files. It needs only bash.
[[nodiscard]] std::string bash_completion(const std::vector<AreaInfo>& areas);

}  // namespace tarsier::cli
