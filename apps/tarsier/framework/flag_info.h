// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <optional>
#include <string>
#include <vector>

namespace tarsier::cli {

// The type of a flag's value.
enum class FlagType { kSwitch, kInteger, kNumber, kText };

// "switch", "integer", "number" or "text".
[[nodiscard]] const char* name_of(FlagType type);

// One flag or positional input as data. Help, manual pages, completion and the tests of all verbs
// are generated from it, so they always agree with the parser.
struct FlagInfo {
  // "--output", "-o": long names first; for a purely positional input its name.
  std::vector<std::string> names;
  // Whether it has no name with dashes.
  bool positional = false;
  // The name of a positional value; empty if it must be given by flag.
  std::string positional_name;
  FlagType type = FlagType::kText;
  // "TEXT", "INT", "UINT", "FLOAT", "FILE"; empty for a switch.
  std::string value;
  // All allowed values, if they are few.
  std::vector<std::string> choices;
  // Words that a text may be, among other values.
  std::vector<std::string> suggestions;
  // If the verb opens a window where the flag is not given: the value with which it opens none.
  std::string headless_value;
  // The range of a number, if it has one.
  std::optional<Range> range;
  // As shown by --help, or empty.
  std::string default_value;
  std::string description;
  // Heading in --help; hidden from --help if empty.
  std::string group;
  bool required = false;
  // Takes any number of values.
  bool many = false;
  // The minimum number of values, and the maximum number of words in a configuration file.
  int min_values = 1;
  int max_items = 1;
  // Names of flags that must be given too, and that must not be given too; sorted.
  std::vector<std::string> needs;
  std::vector<std::string> excludes;
};

}  // namespace tarsier::cli
