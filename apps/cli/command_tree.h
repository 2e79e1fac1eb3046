// SPDX-License-Identifier: MIT
#pragma once

#include <CLI/CLI.hpp>

#include <string>
#include <vector>

namespace tarsier::cli {

// The program's own command line as data: what help, manual pages, completion and the test that
// walks all verbs are made of, so that none of them can differ from what the parser takes.
struct FlagInfo {
  std::vector<std::string> names;  // "--output", "-o"; of a positional its name
  bool positional = false;
  std::string value;                 // "TEXT", "INT", "FLOAT", "FILE" ..; "" of a switch
  std::vector<std::string> choices;  // all that the value may be, if they are few
  std::string range;                 // "0..100", "> 0", ">= 0", or ""
  std::string default_value;         // as --help shows it, or ""
  std::string description;
  std::string group;  // heading in --help
  bool required = false;
  bool many = false;  // several values
};

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
  std::vector<VerbInfo> verbs;  // of an area that is its own verb: that one
};

[[nodiscard]] FlagInfo describe(const CLI::Option& option);

// All areas in the order of their registration, without what is hidden from help.
[[nodiscard]] std::vector<AreaInfo> command_tree(const CLI::App& root);

// The example of a verb ("plate read"): a whole command line, or "" where there is none.
[[nodiscard]] std::string example_of(const std::string& verb);

// --help of a verb or an area.
[[nodiscard]] std::string help_text(const CLI::App& app);

// "plate read"; "" for the program itself.
[[nodiscard]] std::string verb_of(const CLI::App& app);

}  // namespace tarsier::cli
