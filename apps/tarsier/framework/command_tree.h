// SPDX-License-Identifier: MIT
#pragma once

#include "flag_info.h"
#include <string>
#include <vector>

namespace tarsier::cli {

class Command;

// The program's own command line as data. Help, manual pages, completion and the test of all verbs
// are generated from it, so they always agree with the parser.
struct VerbInfo {
  std::vector<std::string> path;  // "plate", "read"
  std::string description;
  std::string usage;    // "tarsier plate read [OPTIONS] INPUT..."
  std::string example;  // "tarsier plate read car.jpg"
  std::vector<FlagInfo> flags;
};

struct AreaInfo {
  std::string name;  // "plate"
  std::string description;
  std::vector<VerbInfo> verbs;  // for an area that is its own verb: only itself
};

// All areas in the order of their registration, without commands hidden from help.
[[nodiscard]] std::vector<AreaInfo> command_tree(const Command& root);

// The --help text of a verb or an area.
[[nodiscard]] std::string help_text(const Command& command);

// "plate read"; "" for the program itself.
[[nodiscard]] std::string verb_of(const Command& command);

// "tarsier plate read"
[[nodiscard]] std::string path_of(const Command& command);

}  // namespace tarsier::cli
