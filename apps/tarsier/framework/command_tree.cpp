// SPDX-License-Identifier: MIT
#include "command_tree.h"

#include "command.h"
#include <algorithm>
#include <cstddef>

namespace tarsier::cli {
namespace {

constexpr std::size_t kHelpColumn = 30;  // column of the descriptions

std::string usage_of(const Command& command, const std::vector<FlagInfo>& flags) {
  std::string usage = path_of(command) + " [OPTIONS]";
  for (const FlagInfo& flag : flags) {
    if (!flag.positional) continue;
    const std::string name = flag.names.front() + (flag.many ? "..." : "");
    usage += ' ' + (flag.required ? name : '[' + name + ']');
  }
  return usage;
}

std::vector<const Command*> shown_parts(const Command& command) {
  std::vector<const Command*> parts = command.subcommands();
  parts.erase(std::remove_if(parts.begin(), parts.end(),
                             [](const Command* part) { return part->hidden(); }),
              parts.end());
  return parts;
}

bool is_help(const FlagInfo& flag) {
  return std::find(flag.names.begin(), flag.names.end(), "--help") != flag.names.end();
}

// The order in --help: positional inputs, then flags without a group, then each group in the order
// of its first flag.
void order_by_group(std::vector<FlagInfo>& flags) {
  std::vector<std::string> groups = {"Options"};
  for (const FlagInfo& flag : flags) {
    if (std::find(groups.begin(), groups.end(), flag.group) == groups.end()) {
      groups.push_back(flag.group);
    }
  }
  const auto rank = [&groups](const FlagInfo& flag) {
    if (flag.positional) return std::ptrdiff_t{-1};
    return std::find(groups.begin(), groups.end(), flag.group) - groups.begin();
  };
  std::stable_sort(flags.begin(), flags.end(),
                   [&rank](const FlagInfo& a, const FlagInfo& b) { return rank(a) < rank(b); });
}

void add_verbs(const Command& command, std::vector<VerbInfo>& verbs) {
  const std::vector<const Command*> parts = shown_parts(command);
  for (const Command* part : parts) add_verbs(*part, verbs);
  if (!parts.empty()) return;
  VerbInfo verb;
  for (const Command* at = &command; at->parent() != nullptr; at = at->parent()) {
    verb.path.insert(verb.path.begin(), at->name());
  }
  verb.description = command.description();
  verb.example = command.example();
  for (FlagInfo& flag : command.flags()) {
    if (!flag.group.empty() && !is_help(flag)) verb.flags.push_back(std::move(flag));
  }
  order_by_group(verb.flags);
  verb.usage = usage_of(command, verb.flags);
  verbs.push_back(std::move(verb));
}

// --- help ---

std::string joined(const std::vector<std::string>& words, const char* between) {
  std::string result;
  for (const std::string& word : words) result += (result.empty() ? "" : between) + word;
  return result;
}

// "  name      description"; the description is on its own line if the name is too long.
std::string help_line(const std::string& name, const std::string& description) {
  const std::string indent(kHelpColumn, ' ');
  std::string line = "  " + name;
  const bool fits = line.size() < kHelpColumn;
  line.resize(std::max(line.size(), kHelpColumn), ' ');
  if (!description.empty() && !fits) line += '\n' + indent;
  for (const char c : description) {
    line += c;
    if (c == '\n') line += indent;
  }
  return line + '\n';
}

// Short names first, as usual.
std::string names_in_help(const FlagInfo& flag) {
  std::vector<std::string> names = flag.names;
  std::stable_partition(names.begin(), names.end(),
                        [](const std::string& name) { return !name.starts_with("--"); });
  return joined(names, ",");
}

std::string relations(const char* word, const std::vector<std::string>& others) {
  return others.empty() ? "" : std::string(" ") + word + ": " + joined(others, " ");
}

// The text after a flag's names.
std::string value_in_help(const FlagInfo& flag) {
  std::string text = flag.value.empty() ? "" : ' ' + flag.value;
  if (!flag.choices.empty()) text = " {" + joined(flag.choices, ",") + '}';
  if (flag.range) text += " (" + flag.range->text() + ')';
  if (!flag.default_value.empty()) text += '=' + flag.default_value;
  if (flag.many) text += " ...";
  if (!flag.many && flag.min_values > 1) text += " x " + std::to_string(flag.min_values);
  if (flag.required) text += " REQUIRED";
  return text + relations("Needs", flag.needs) + relations("Excludes", flag.excludes);
}

std::string usage_in_help(const Command& command, const std::vector<FlagInfo>& flags) {
  std::string usage = "Usage: " + path_of(command) + " [OPTIONS]";
  for (const FlagInfo& flag : flags) {
    if (flag.positional_name.empty()) continue;
    std::string name = flag.positional_name;
    if (flag.many) {
      name += "...";
    } else if (flag.min_values > 1) {
      name += '(' + std::to_string(flag.min_values) + "x)";
    }
    usage += ' ' + (flag.required ? name : '[' + name + ']');
  }
  if (!command.subcommands().empty()) {
    usage += command.min_subcommands() == 0 ? " [SUBCOMMAND]" : " SUBCOMMAND";
  }
  usage += '\n';
  if (!command.example().empty()) usage += "Example: " + command.example() + '\n';
  return usage;
}

}  // namespace

std::vector<AreaInfo> command_tree(const Command& root) {
  std::vector<AreaInfo> areas;
  for (const Command* part : shown_parts(root)) {
    AreaInfo area;
    area.name = part->name();
    area.description = part->description();
    add_verbs(*part, area.verbs);
    areas.push_back(std::move(area));
  }
  return areas;
}

std::string verb_of(const Command& command) {
  if (command.parent() == nullptr) return {};
  const std::string above = verb_of(*command.parent());
  return above.empty() ? command.name() : above + ' ' + command.name();
}

std::string path_of(const Command& command) {
  const std::string verb = verb_of(command);
  return verb.empty() ? "tarsier" : "tarsier " + verb;
}

std::string help_text(const Command& command) {
  const std::vector<FlagInfo> flags = command.flags();
  std::string text = command.description() + '\n' + usage_in_help(command, flags);

  std::string positionals;
  std::vector<std::string> groups;
  for (const FlagInfo& flag : flags) {
    if (!flag.positional_name.empty() && !flag.group.empty()) {
      positionals += help_line(flag.positional_name + value_in_help(flag), flag.description);
    }
    if (std::find(groups.begin(), groups.end(), flag.group) == groups.end()) {
      groups.push_back(flag.group);
    }
  }
  if (!positionals.empty()) text += "\nPositionals:\n" + positionals;
  for (const std::string& group : groups) {
    if (group.empty()) continue;  // hidden
    std::string lines;
    for (const FlagInfo& flag : flags) {
      if (flag.group != group || flag.positional) continue;
      lines += help_line(names_in_help(flag) + value_in_help(flag), flag.description);
    }
    if (lines.empty()) continue;
    text += '\n' + group + ":\n" + lines;
    if (group != groups.back()) text += '\n';
  }

  std::string parts;
  for (const Command* part : shown_parts(command)) {
    parts += help_line(part->name(), part->description());
  }
  if (!parts.empty()) text += "\nSubcommands:\n" + parts;
  return text + '\n';
}

}  // namespace tarsier::cli
