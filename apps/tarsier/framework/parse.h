// SPDX-License-Identifier: MIT
#pragma once

#include "command.h"
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::cli {

// The command that the first of `words` lead to, and how many of them were used.
struct Chosen {
  Command* command = nullptr;
  std::size_t words = 0;
};
[[nodiscard]] Chosen chosen_command(Command& root, const std::vector<std::string>& words);

// Whether it has sub-commands, of which one must follow.
[[nodiscard]] bool is_area(const Command& command);

// Reads a whole command line. Flags by their former names are taken, with a warning; an unknown word
// is an error that says what was probably meant. The values of the file of --config go behind the
// words, which win. In that file, top-level keys are the chosen verb's; a section [area.verb] holds
// those of one verb, so that one file can serve several. Throws UsageError where the line breaks a
// rule, InputError for the file.
Command::Parsed parse_command_line(Command& root, std::vector<std::string> words);

// The version of the parser (CLI11) that the program was built with.
[[nodiscard]] std::string parser_version();

// What was probably meant by `word`: the nearest of `known`, or an empty string if none is near.
[[nodiscard]] std::string nearest_word(std::string_view word,
                                       const std::vector<std::string>& known);

}  // namespace tarsier::cli
