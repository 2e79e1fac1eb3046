// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <optional>
#include <string>
#include <vector>

namespace tarsier::cli {

// What a flag's value is.
enum class FlagType { kSwitch, kInteger, kNumber, kText };

// "switch", "integer", "number" or "text".
[[nodiscard]] const char* name_of(FlagType type);

// One flag or positional input as data: what help, manual pages, completion and the tests of all
// verbs are made of, so that none of them can differ from what the parser takes.
struct FlagInfo {
  // "--output", "-o": long names first; of what is only positional its name.
  std::vector<std::string> names;
  // Whether it has no name with dashes.
  bool positional = false;
  // Of what may be given without its name; else empty.
  std::string positional_name;
  FlagType type = FlagType::kText;
  // "TEXT", "INT", "UINT", "FLOAT", "FILE"; empty for a switch.
  std::string value;
  // All that the value may be, if they are few.
  std::vector<std::string> choices;
  // Of a number, if it has one.
  std::optional<Range> range;
  // As --help shows it, or empty.
  std::string default_value;
  std::string description;
  // Heading in --help; hidden from it if empty.
  std::string group;
  bool required = false;
  // Any number of values.
  bool many = false;
  // How many values it takes at least, and how many words of a configuration file it takes at most.
  int min_values = 1;
  int max_items = 1;
  // Names of flags that must, or must not, be given too; sorted.
  std::vector<std::string> needs;
  std::vector<std::string> excludes;
};

}  // namespace tarsier::cli
