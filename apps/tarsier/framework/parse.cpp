// SPDX-License-Identifier: MIT
#include "parse.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include "command_tree.h"
#include <algorithm>
#include <cstddef>
#include <numeric>
#include <utility>

namespace tarsier::cli {
namespace {

std::vector<std::string> names_of(const std::vector<const Command*>& commands) {
  std::vector<std::string> names;
  for (const Command* command : commands) names.push_back(command->name());
  return names;
}

bool is_long(const std::string& name) { return name.starts_with("--"); }

std::vector<std::string> long_names(const Command& command) {
  std::vector<std::string> names;
  for (const FlagInfo& flag : command.flags()) {
    std::copy_if(flag.names.begin(), flag.names.end(), std::back_inserter(names), is_long);
  }
  return names;
}

// The present name of a renamed flag ("--least-side" is now "--min-side"). Empty if `flag` is no
// former name of a flag of this command. `flag` has no "=value".
std::string current_name(const std::string& flag, const std::vector<std::string>& known) {
  constexpr std::pair<std::string_view, std::string_view> kPrefixes[] = {
      {"--least-", "--min-"},
      {"--most-", "--max-"},
      {"--film", "--video"},
      {"--least", "--min-markers"},
      {"--least", "--min-faces"},
      {"--least", "--min-sightings"},
      {"--most", "--max-markers"},
      {"--most", "--max-samples"},
      {"--judge-steps", "--refine-steps"}};
  for (const auto& [old, present] : kPrefixes) {
    if (!flag.starts_with(old)) continue;
    std::string name = std::string(present) + flag.substr(old.size());
    if (std::find(known.begin(), known.end(), name) != known.end()) return name;
  }
  return {};
}

// Replaces former names of flags by the present ones, with a warning.
void replace_former_names(Command& root, std::vector<std::string>& words) {
  const CommandMatch match = match_command(root, words);
  if (is_area(*match.command)) return;
  const std::vector<std::string> known = long_names(*match.command);
  for (std::size_t i = match.word_count; i < words.size() && words[i] != "--"; ++i) {
    if (!is_long(words[i])) continue;
    const std::string flag = words[i].substr(0, words[i].find('='));
    if (std::find(known.begin(), known.end(), flag) != known.end()) continue;
    const std::string name = current_name(flag, known);
    if (name.empty()) continue;
    log_warning("{} is {} now", flag, name);
    words[i].replace(0, flag.size(), name);
  }
}

// Throws UsageError for an unknown area, verb or flag; the message suggests a known one.
void check_words(Command& root, const std::vector<std::string>& words) {
  const CommandMatch match = match_command(root, words);
  const Command& command = *match.command;
  if (match.word_count == words.size()) return;
  const std::string& word = words[match.word_count];
  if (is_area(command)) {
    if (word == "-h" || word == "--help" || (word == "--version" && &command == &root)) return;
    if (word.starts_with("-") && &command == &root) {
      throw UsageError(
          fmt::format("unknown flag {} here: flags come after the verb (tarsier --help)", word));
    }
    const std::vector<std::string> known = names_of(command.subcommands());
    const std::string meant = nearest_word(word, known);
    throw UsageError(fmt::format("'{}' knows no '{}': {}", path_of(command), word,
                                 meant.empty() ? fmt::format("known: {}", fmt::join(known, ", "))
                                               : "did you mean '" + meant + "'?"));
  }
  const std::vector<std::string> known = long_names(command);
  for (std::size_t i = match.word_count; i < words.size() && words[i] != "--"; ++i) {
    if (!is_long(words[i])) continue;
    const std::string flag = words[i].substr(0, words[i].find('='));
    if (std::find(known.begin(), known.end(), flag) != known.end()) continue;
    const std::string meant = nearest_word(flag, known);
    throw UsageError(fmt::format(
        "'{}' has no flag {}: {}", path_of(command), flag,
        meant.empty() ? "see " + path_of(command) + " --help" : "did you mean " + meant + "?"));
  }
}

// --- --config ---

bool given_on_line(const FlagInfo& flag, const std::vector<std::string>& words, std::size_t from) {
  for (std::size_t i = from; i < words.size() && words[i] != "--"; ++i) {
    const std::string& word = words[i];
    for (const std::string& name : flag.names) {
      if (is_long(name)) {
        if (word == name || word.starts_with(name + "=")) return true;
      } else if (!flag.positional && word.starts_with(name) && !is_long(word)) {
        return true;
      }
    }
  }
  return false;
}

// Whether a key of the file is the list of the verb's inputs: input = ["a", "b"].
bool is_input_of(const Command& verb, const std::string& key) {
  if (key != "input") return false;
  const std::vector<FlagInfo> flags = verb.flags();
  return std::any_of(flags.begin(), flags.end(), [](const FlagInfo& flag) {
    return flag.positional && flag.many && flag.positional_name == "INPUT";
  });
}

void add_entry(const Command& verb, const ConfigEntry& entry, const std::string& path,
               const std::vector<std::string>& words, std::size_t from,
               std::vector<std::string>& inputs, std::vector<std::string>& added) {
  const std::vector<std::string> known = long_names(verb);
  if (is_input_of(verb, entry.name)) {
    inputs.insert(inputs.end(), entry.values.begin(), entry.values.end());
    return;
  }
  const std::string former = current_name("--" + entry.name, known);
  if (!former.empty()) log_warning("{}: {} is {} now", path, entry.name, former.substr(2));
  const std::string name = former.empty() ? "--" + entry.name : former;
  const std::vector<FlagInfo> flags = verb.flags();
  const auto flag = std::find_if(flags.begin(), flags.end(), [&name](const FlagInfo& candidate) {
    return std::find(candidate.names.begin(), candidate.names.end(), name) != candidate.names.end();
  });
  if (flag == flags.end() || entry.name == "config" || entry.name == "help") {
    const std::string meant = nearest_word(name, known);
    throw UsageError(fmt::format("{}: '{}' has no option '{}'{}", path, path_of(verb), entry.name,
                                 meant.empty() ? "" : ": did you mean '" + meant.substr(2) + "'?"));
  }
  if (given_on_line(*flag, words, from)) return;  // the command line takes precedence
  if (entry.values.empty()) {
    throw UsageError(fmt::format("{}: '{}' has no value", path, entry.name));
  }
  if (entry.values.size() == 1 || flag->max_items == 1) {  // a list as one word, "60,25,20"
    added.push_back(fmt::format("{}={}", name, fmt::join(entry.values, ",")));
  } else if (flag->many) {  // one by one: some flags take one value at a time
    for (const std::string& value : entry.values)
      added.push_back(fmt::format("{}={}", name, value));
  } else {
    added.push_back(name);
    added.insert(added.end(), entry.values.begin(), entry.values.end());
  }
}

// Appends the values of the file of --config to the words.
std::vector<std::string> with_config(Command& root, std::vector<std::string> words) {
  const CommandMatch match = match_command(root, words);
  const Command& verb = *match.command;
  std::string path;
  const auto end =
      static_cast<std::size_t>(std::find(words.begin(), words.end(), "--") - words.begin());
  for (std::size_t i = match.word_count; i < end; ++i) {
    if (words[i] == "--config" && i + 1 < end) path = words[i + 1];
    if (words[i].starts_with("--config=")) path = words[i].substr(9);
  }
  if (path.empty() || is_area(verb)) return words;

  const std::string text = read_file(path, 1'000'000);
  std::vector<ConfigEntry> entries;
  try {
    entries = read_config(text);
  } catch (const std::exception& error) {
    throw InputError(path, fmt::format("not a TOML or INI file: {}", error.what()));
  }
  std::vector<std::string> inputs;  // inserted before those of the words
  std::vector<std::string> added;
  for (const ConfigEntry& entry : entries) {
    if (!entry.parents.empty()) {
      const CommandMatch section = match_command(root, entry.parents);
      if (section.word_count < entry.parents.size() || is_area(*section.command)) {
        throw UsageError(fmt::format("{}: [{}.{}] is not an area and verb", path,
                                     fmt::join(entry.parents, "."), entry.name));
      }
      if (section.command != &verb) continue;
    }
    add_entry(verb, entry, path, words, match.word_count, inputs, added);
  }
  words.insert(words.begin() + static_cast<std::ptrdiff_t>(end), added.begin(), added.end());
  words.insert(words.begin() + static_cast<std::ptrdiff_t>(match.word_count), inputs.begin(),
               inputs.end());
  return words;
}

}  // namespace

CommandMatch match_command(Command& root, const std::vector<std::string>& words) {
  CommandMatch match{&root, 0};
  for (const std::string& word : words) {
    Command* next = match.command->find(word);
    if (next == nullptr) break;
    match.command = next;
    ++match.word_count;
  }
  return match;
}

bool is_area(const Command& command) { return !command.subcommands().empty(); }

Command::Parsed parse_command_line(Command& root, std::vector<std::string> words) {
  replace_former_names(root, words);
  check_words(root, words);
  return root.parse(with_config(root, std::move(words)));
}

std::string nearest_word(std::string_view word, const std::vector<std::string>& known) {
  const auto distance = [word](std::string_view other) {  // Levenshtein
    std::vector<std::size_t> row(other.size() + 1);
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (std::size_t i = 1; i <= word.size(); ++i) {
      std::size_t diagonal = row[0];
      row[0] = i;
      for (std::size_t j = 1; j <= other.size(); ++j) {
        const std::size_t above = row[j];
        const std::size_t change = diagonal + (word[i - 1] == other[j - 1] ? 0 : 1);
        row[j] = std::min({above + 1, row[j - 1] + 1, change});
        diagonal = above;
      }
    }
    return row.back();
  };
  std::string best;
  if (word.size() > 64) return best;
  std::size_t best_distance = std::max<std::size_t>(2, word.size() / 3) + 1;
  for (const std::string& name : known) {
    if (const std::size_t d = distance(name); d < best_distance) {
      best_distance = d;
      best = name;
    }
  }
  return best;
}

}  // namespace tarsier::cli
