// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/watch.h"

#include "tarsier/core/log.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/plate/tracking/log.h"

#include <fmt/format.h>

#include "verbs/plate/plate.h"
#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <system_error>
#include <vector>

namespace tarsier::cli {
namespace {

using plate::WatchEntry;
using plate::WatchList;

constexpr const char* kAny = "any";

struct WatchFlags {
  std::string list;
  std::string plate;  // for `add` and `remove`
  std::vector<std::string> texts;
  // for `add`: a column without a flag keeps its value
  std::optional<std::string> label;
  std::optional<double> errors;
  std::optional<std::string> hours;
  std::optional<std::string> days;
  std::string direction;
  std::string at;
};

std::string text_or_any(const std::string& text) { return text.empty() ? "any" : text; }

std::string line_of(const WatchEntry& entry) {
  return fmt::format(
      "{:<12} {:<20} errors {:<5g} {:<12} {:<14} {}\n", entry.plate, printable(entry.label),
      entry.errors, text_or_any(entry.direction ? std::string(name_of(*entry.direction)) : ""),
      text_or_any(plate::hours_text(entry.hours)), text_or_any(plate::days_text(entry.days)));
}

void print_entry(const WatchEntry& entry, const char* state, const Context& context) {
  if (context.json) {
    nlohmann::ordered_json line = plate::watch_entry_json(entry);
    if (*state != '\0') line["state"] = state;
    print_json(line);
    return;
  }
  print_text((*state == '\0' ? "" : std::string(state) + ": ") + line_of(entry));
}

// The entry of the plate in the list, or a new one, with the values of the given flags.
WatchEntry changed_entry(const WatchList& list, const WatchFlags& flags) {
  WatchEntry entry;
  entry.plate = plate::plate_pattern(flags.plate, "PLATE");
  const auto present =
      std::find_if(list.entries().begin(), list.entries().end(),
                   [&](const WatchEntry& other) { return other.plate == entry.plate; });
  if (present != list.entries().end()) entry = *present;
  if (flags.label) entry.label = plate::checked_label(*flags.label, "--label");
  if (flags.errors) entry.errors = *flags.errors;
  const auto column = [](const std::string& text) { return text == kAny ? "" : text; };
  if (flags.direction == kAny) {
    entry.direction.reset();
  } else if (!flags.direction.empty()) {
    entry.direction = plate::parse_direction(flags.direction, "--direction");
  }
  if (flags.hours) entry.hours = plate::parse_hours(column(*flags.hours), "--hours");
  if (flags.days) entry.days = plate::parse_days(column(*flags.days), "--days");
  return entry;
}

ExitStatus run_add(const WatchFlags& flags, const Context& context) {
  const FileDescriptor lock = lock_folder_of(flags.list);
  std::error_code error;
  WatchList list;
  if (std::filesystem::exists(flags.list, error) || error) list = WatchList::read(flags.list);
  const WatchEntry entry = changed_entry(list, flags);
  const bool replaced = list.add(entry);
  list.write(flags.list);
  print_entry(entry, replaced ? "changed" : "added", context);
  return ExitStatus::kDone;
}

ExitStatus run_remove(const WatchFlags& flags, const Context& context) {
  const std::string pattern = plate::plate_pattern(flags.plate, "PLATE");
  const FileDescriptor lock = lock_folder_of(flags.list);
  WatchList list = WatchList::read(flags.list);
  std::vector<WatchEntry> removed;
  for (const WatchEntry& entry : list.entries()) {
    if (entry.plate == pattern) removed.push_back(entry);
  }
  if (removed.empty()) {
    log_info("{}: no entry for {}", flags.list, pattern);
    return ExitStatus::kNothingFound;
  }
  while (list.remove(pattern)) {
  }
  list.write(flags.list);
  for (const WatchEntry& entry : removed) print_entry(entry, "removed", context);
  return ExitStatus::kDone;
}

ExitStatus run_list(const WatchFlags& flags, const Context& context) {
  const WatchList list = WatchList::read(flags.list);
  for (const WatchEntry& entry : list.entries()) print_entry(entry, "", context);
  return list.entries().empty() ? ExitStatus::kNothingFound : ExitStatus::kDone;
}

ExitStatus run_test(const WatchFlags& flags, const Context& context) {
  const WatchList list = WatchList::read(flags.list);
  const plate::Moment now = plate::moment_now();
  const plate::LocalTime local_time =
      plate::local_time(flags.at.empty() ? now : plate::parse_moment(flags.at, now, false, "--at"));
  std::vector<plate::Direction> directions;
  if (!flags.direction.empty())
    directions.push_back(plate::parse_direction(flags.direction, "--direction"));
  bool found = false;
  for (const std::string& typed_text : flags.texts) {
    const std::string text = plate::plate_pattern(typed_text, "TEXT");
    if (text.find_first_of("*?") != std::string::npos)
      throw UsageError(
          fmt::format("TEXT '{}': a text that a camera reads is expected, without "
                      "'*' and '?'",
                      printable(typed_text)));
    const auto matches = list.matches(text, local_time, directions.empty() ? nullptr : &directions);
    found = found || !matches.empty();
    if (context.json) {
      nlohmann::ordered_json line{{"text", text}, {"watch", nlohmann::ordered_json::array()}};
      for (const plate::WatchMatch& match : matches)
        line["watch"].push_back(plate::watch_json(match));
      print_json(line);
      continue;
    }
    if (matches.empty()) print_text(fmt::format("{}: none\n", text));
    for (const plate::WatchMatch& match : matches) {
      print_text(fmt::format("{}: {} {:.2f} {}\n", text, match.entry->plate, match.distance,
                             printable(match.entry->label)));
    }
  }
  return found ? ExitStatus::kDone : ExitStatus::kNothingFound;
}

void add_list_input(Command& verb, WatchFlags& flags, const char* help) {
  verb.add_option("LIST", flags.list, help).required();
}

void add_add_flags(Command& verb, WatchFlags& flags) {
  add_list_input(verb, flags, "watch list file; created if missing");
  verb.add_option("PLATE", flags.plate, "plate text; * matches any characters, ? any one character")
      .required();
  verb.add_option("--label", flags.label, "label: owner or reason");
  verb.add_option(
          "--tolerate", flags.errors,
          "maximum reading error: 1 allows any one edit, 0.25 or 0.5 only common confusions")
      .check(range(0.0, WatchEntry::kMaxErrors))
      .show_default(fmt::format("{:g}", WatchEntry::kDefaultErrors));
  std::vector<std::string> names{kAny};
  for (const plate::Direction direction : plate::kDirections)
    names.emplace_back(name_of(direction));
  verb.add_option("--direction", flags.direction, "only vehicles that move in this direction")
      .check(one_of(names));
  verb.add_option("--hours", flags.hours, "only at these hours, local time: 22:00-06:00, or any");
  verb.add_option("--days", flags.days,
                  "days on which the hours begin: mon-fri, 'sat sun', or any");
}

void add_remove_flags(Command& verb, WatchFlags& flags) {
  add_list_input(verb, flags, "watch list file");
  verb.add_option("PLATE", flags.plate, "plate text as in the list").required();
}

void add_list_flags(Command& verb, WatchFlags& flags) {
  add_list_input(verb, flags, "watch list file");
}

void add_test_flags(Command& verb, WatchFlags& flags) {
  add_list_input(verb, flags, "watch list file");
  verb.add_option("TEXT", flags.texts, "plate texts as read by a camera").required();
  verb.add_option("--at", flags.at, "time of the reading: 2024-05-01T12:30 (UTC) [now]");
  std::vector<std::string> names;
  for (const plate::Direction direction : plate::kDirections)
    names.emplace_back(name_of(direction));
  verb.add_option("--direction", flags.direction, "direction of motion [any]").check(one_of(names));
}

}  // namespace

void add_plate_watch(Command& plate, Context& context) {
  Command& watch =
      plate.add_subcommand("watch", "manage watch lists of plates for `plate read --watch`");
  watch.require_subcommand(1);
  add_verb<WatchFlags>(watch, "add",
                       "add a plate to a list, or change the given columns of its entry", context,
                       add_add_flags, run_add);
  add_verb<WatchFlags>(watch, "remove", "remove a plate from a list", context, add_remove_flags,
                       run_remove);
  add_verb<WatchFlags>(watch, "list", "show a list", context, add_list_flags, run_list);
  add_verb<WatchFlags>(watch, "test", "show which entries match a text", context, add_test_flags,
                       run_test);
}

}  // namespace tarsier::cli
