// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/face/people/export.h"

#include <fmt/format.h>

#include "verbs/people/engine.h"
#include "verbs/people/people.h"
#include <charconv>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

using face::people::Correction;
using face::people::Gallery;

struct CorrectFlags {
  PeopleFlags people;
  std::string from;
  std::string to;
  std::vector<int> faces;
  std::vector<int> sightings;
  int face = 0;
  int sighting = 0;
  int group = 0;
  int id = 0;
  bool groups = false;
};

std::vector<std::int64_t> to_int64(const std::vector<int>& ids) { return {ids.begin(), ids.end()}; }

std::int64_t group_of(const std::string& text) {
  std::int64_t id = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), id);
  if (error != std::errc() || end != text.data() + text.size() || id < 1)
    throw UsageError(fmt::format("'{}' is not a group number: `people groups` lists them", text));
  return id;
}

ExitStatus report_correction(Gallery& gallery, std::int64_t id, const Context& context) {
  const auto entry = gallery.correction(id);
  if (!entry) return ExitStatus::kDone;
  if (context.json) {
    print_json(to_json(*entry, time_text));
  } else if (entry->kind == "undo") {
    print_text(fmt::format("Correction {}: {}\n", id, text_of(*entry)));
  } else {
    print_text(fmt::format("Correction {}: {}. Undo it with `people correct undo {}`\n", id,
                           text_of(*entry), id));
  }
  return ExitStatus::kDone;
}

Gallery open(const CorrectFlags& flags) {
  return face::open_gallery_to_write(flags.people.gallery);
}

ExitStatus correct_not(const CorrectFlags& flags, const Context& context) {
  if ((flags.face == 0) == (flags.sighting == 0))
    throw UsageError("give either --face ID or --sighting ID");
  Gallery gallery = open(flags);
  return report_correction(gallery,
                           flags.face > 0
                               ? gallery.not_this_face(flags.face, correction_stamp())
                               : gallery.not_this_sighting(flags.sighting, correction_stamp()),
                           context);
}

ExitStatus correct_move(const CorrectFlags& flags, const Context& context) {
  Gallery gallery = open(flags);
  return report_correction(
      gallery, gallery.move_faces(to_int64(flags.faces), flags.to, correction_stamp()), context);
}

ExitStatus correct_merge(const CorrectFlags& flags, const Context& context) {
  Gallery gallery = open(flags);
  return report_correction(
      gallery,
      flags.groups
          ? gallery.merge_groups(group_of(flags.from), group_of(flags.to), correction_stamp())
          : gallery.merge_people(flags.from, flags.to, correction_stamp()),
      context);
}

ExitStatus correct_split(const CorrectFlags& flags, const Context& context) {
  if (flags.group > 0) {
    if (!flags.from.empty() || !flags.faces.empty())
      throw UsageError("--group can only be combined with --sighting");
    if (flags.sightings.empty()) throw UsageError("--sighting ID is missing");
    Gallery gallery = open(flags);
    return report_correction(
        gallery, gallery.split_group(flags.group, to_int64(flags.sightings), correction_stamp()),
        context);
  }
  if (flags.from.empty() || flags.to.empty())
    throw UsageError("give FROM TO --face ID, or --group ID --sighting ID");
  if (!flags.sightings.empty()) throw UsageError("--sighting needs --group");
  if (flags.faces.empty()) throw UsageError("--face ID is missing");
  Gallery gallery = open(flags);
  return report_correction(
      gallery,
      gallery.split_person(flags.from, to_int64(flags.faces), flags.to, correction_stamp()),
      context);
}

ExitStatus correct_undo(const CorrectFlags& flags, const Context& context) {
  Gallery gallery = open(flags);
  return report_correction(gallery, gallery.undo(flags.id, correction_stamp()), context);
}

struct CorrectionLogFlags {
  PeopleFlags people;
  std::int64_t limit = 0;
};

ExitStatus show_log(const CorrectionLogFlags& flags, const Context& context) {
  Gallery gallery = face::open_gallery(flags.people.gallery);
  const auto entries = gallery.corrections(flags.limit);
  for (const Correction& entry : entries) {
    if (context.json) {
      print_json(to_json(entry, time_text));
    } else {
      print_text(fmt::format("{:>6}  {}  {:<12} {}\n", entry.id,
                             time_text(entry.time).substr(0, 19), printable(entry.actor),
                             text_of(entry)));
    }
  }
  if (entries.empty()) log_info("{}: nothing was corrected", flags.people.gallery);
  return entries.empty() ? ExitStatus::kNothingFound : ExitStatus::kDone;
}

void add_faces_flag(Command& verb, CorrectFlags& flags, bool required) {
  Flag& flag = verb.add_option(
      "--face", flags.faces,
      "number of a face, as `people list --faces NAME` shows it; repeatable [none]");
  flag.check(at_least(1)).one_value_each();
  if (required) flag.required();
}

void add_not_flags(Command& verb, CorrectFlags& flags) {
  verb.add_option("--face", flags.face,
                  "number of the enrolled face, as `people list --faces NAME` shows it [none]")
      .check(at_least(1));
  verb.add_option("--sighting", flags.sighting,
                  "number of the sighting, as `people list --sightings` shows it [none]")
      .check(at_least(1));
  add_gallery_flag(verb, flags.people);
}

void add_move_flags(Command& verb, CorrectFlags& flags) {
  verb.add_option("TO", flags.to, "name of the right person; enrolled if new").required();
  add_faces_flag(verb, flags, true);
  add_gallery_flag(verb, flags.people);
}

void add_merge_flags(Command& verb, CorrectFlags& flags) {
  verb.add_option("FROM", flags.from, "name to remove; with --groups its number").required();
  verb.add_option("INTO", flags.to, "name to keep; with --groups its number").required();
  verb.add_flag("--groups", flags.groups, "merge two groups of unknown faces");
  add_gallery_flag(verb, flags.people);
}

void add_split_flags(Command& verb, CorrectFlags& flags) {
  verb.add_option("FROM", flags.from, "name of the present person");
  verb.add_option("TO", flags.to, "name of the new person");
  add_faces_flag(verb, flags, false);
  verb.add_option("--group", flags.group,
                  "split a group of unknown faces instead of a person [none]")
      .check(at_least(1));
  verb.add_option("--sighting", flags.sightings,
                  "number of a sighting of the group; repeatable [none]")
      .check(at_least(1))
      .one_value_each();
  add_gallery_flag(verb, flags.people);
}

void add_undo_flags(Command& verb, CorrectFlags& flags) {
  verb.add_option("ID", flags.id, "number of the correction [the last one in force]")
      .check(at_least(1));
  add_gallery_flag(verb, flags.people);
}

void add_log_flags(Command& verb, CorrectionLogFlags& flags) {
  add_gallery_flag(verb, flags.people);
  verb.add_option("--limit", flags.limit, "maximum number of entries, newest first; 0: all")
      .check(at_least(0))
      .show_default();
}

}  // namespace

void add_people_correct(Command& area, Context& context) {
  Command& correct =
      area.add_subcommand("correct", "correct identities; `correct undo` takes a correction back");
  correct.require_subcommand(1);
  add_verb<CorrectFlags>(correct, "not",
                         "mark a face as not this person; it then counts against this person",
                         context, add_not_flags, correct_not);
  add_verb<CorrectFlags>(correct, "move", "move faces to another person", context, add_move_flags,
                         correct_move);
  add_verb<CorrectFlags>(correct, "merge", "merge two people or two groups", context,
                         add_merge_flags, correct_merge);
  add_verb<CorrectFlags>(correct, "split", "move faces of a person or group to a new person",
                         context, add_split_flags, correct_split);
  add_verb<CorrectFlags>(correct, "undo", "undo a correction", context, add_undo_flags,
                         correct_undo);
  add_verb<CorrectionLogFlags>(area, "log", "list the corrections: time, author, change", context,
                               add_log_flags, show_log);
}

}  // namespace tarsier::cli
