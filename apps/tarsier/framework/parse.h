// SPDX-License-Identifier: MIT
#pragma once

#include "command.h"
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::cli {

// The command that the first of `words` select, and the number of words used.
struct CommandMatch {
  Command* command = nullptr;
  std::size_t word_count = 0;
};
[[nodiscard]] CommandMatch match_command(Command& root, const std::vector<std::string>& words);

// Whether it has sub-commands, one of which must follow.
[[nodiscard]] bool is_area(const Command& command);

// Parses a whole command line. Former names of flags are accepted with a warning. For an unknown
// word the error suggests the most similar known one. Values from the file of --config are appended
// to the words; the command line takes precedence. In that file, top-level keys apply to the chosen
// verb, and a section [area.verb] applies to one verb, so one file can serve several verbs. Throws
// UsageError if the line breaks a rule, InputError for the file.
Command::Parsed parse_command_line(Command& root, std::vector<std::string> words);

// The version of the parser (CLI11) that the program was built with.
[[nodiscard]] std::string parser_version();

// The most similar word of `known`, or an empty string if none is similar.
[[nodiscard]] std::string nearest_word(std::string_view word,
                                       const std::vector<std::string>& known);

}  // namespace tarsier::cli
