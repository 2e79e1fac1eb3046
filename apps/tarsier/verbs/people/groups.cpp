// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/face/people/grouping.h"
#include "tarsier/image/draw/tile.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include "framework/bind.h"
#include "verbs/people/engine.h"
#include "verbs/people/images.h"
#include "verbs/people/people.h"
#include <algorithm>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

struct GroupFlags {
  PeopleFlags people;
  face::people::GroupingOptions grouping;
};

// The background that defines the comparison of this gallery's faces, enrolled or not.
face::recognition::Background directions_of(face::people::Gallery& gallery,
                                            const PeopleFlags& flags) {
  face::resolve_template_kind(gallery, template_kind(flags), ModelStore::find(), true,
                              own_network(flags));
  if (face::has_deep_templates(gallery)) return find_deep_background(flags);
  auto background = find_background(flags);
  if (!background || background->basis.rows() == 0)
    throw UsageError(
        "grouping needs a background: the shipped people-background.json, or another one with "
        "directions");
  return std::move(*background);
}

ExitStatus group_faces(const GroupFlags& flags, Context& context) {
  face::people::Gallery gallery = face::open_gallery_to_write(flags.people.gallery);
  const auto background = directions_of(gallery, flags.people);
  const auto report = face::people::group_sightings(gallery, background, flags.grouping,
                                                    *context.progress, context.stop);
  if (context.json) {
    print_json({{"placed", report.assigned},
                {"new", report.new_groups},
                {"merged", report.merged},
                {"groups", report.groups},
                {"threshold", rounded(report.threshold, 4)}});
  } else {
    print_text(fmt::format("unknown faces placed: {}; groups: {} new, {} merged, {} now\n",
                           report.assigned, report.new_groups, report.merged, report.groups));
  }
  return report.groups > 0 ? ExitStatus::kDone : ExitStatus::kNothingFound;
}

struct GroupsFlags {
  PeopleFlags people;
  int group = 0;
  std::int64_t min_sightings = 1;
  std::string draw;
};

// Draws the best faces of each group, one row per group.
void draw_groups(face::people::Gallery& gallery,
                 const std::vector<face::people::SightingGroup>& groups, const std::string& path) {
  constexpr std::size_t kColumns = 8;
  constexpr std::size_t kMaxRows = 200;  // max rows: larger images are of no use
  std::vector<cv::Mat> rows;
  for (const auto& group : groups) {
    if (rows.size() == kMaxRows) {
      log_warning("the first {} groups are drawn, of {}", kMaxRows, groups.size());
      break;
    }
    auto sightings = gallery.group_sightings(group.id);
    std::stable_sort(sightings.begin(), sightings.end(),
                     [](const auto& a, const auto& b) { return a.quality > b.quality; });
    std::vector<cv::Mat> images(kColumns);
    std::vector<std::string> names(kColumns);
    for (std::size_t i = 0; i < kColumns && i < sightings.size(); ++i) {
      if (const auto face = gallery.sighting_face(sightings[i].id)) images[i] = face->crop;
      names[i] = i == 0 ? fmt::format("group {}: {}", group.id, group.sightings)
                        : fmt::format("{}", sightings[i].id);
    }
    rows.push_back(image::draw::tile(images, names, {static_cast<int>(kColumns) * 108, 150}));
  }
  cv::Mat sheet;
  cv::vconcat(rows, sheet);
  write_image(path, sheet);
}

void list_sightings(face::people::Gallery& gallery, const GroupsFlags& flags,
                    const Context& context) {
  FaceSheet sheet(flags.draw);
  for (const auto& sighting : gallery.group_sightings(flags.group)) {
    nlohmann::ordered_json line = {{"id", sighting.id},
                                   {"group", sighting.group},
                                   {"time", time_text(sighting.time)},
                                   {"source", sighting.source},
                                   {"quality", rounded(sighting.quality, 3)}};
    const auto face = sheet.is_drawn() ? gallery.sighting_face(sighting.id) : std::nullopt;
    sheet.add(face ? face->crop : cv::Mat(), sighting.id, line);
    if (context.json) {
      print_json(line);
    } else {
      print_text(fmt::format("{:>6}  {}  quality {:.2f}  {}\n", sighting.id,
                             time_text(sighting.time).substr(0, 19), sighting.quality,
                             printable(sighting.source)));
    }
  }
  sheet.write();
}

ExitStatus list_groups(const GroupsFlags& flags, const Context& context) {
  face::people::Gallery gallery = face::open_gallery(flags.people.gallery);
  std::vector<face::people::SightingGroup> groups = gallery.groups();
  if (flags.group != 0) {
    std::erase_if(groups, [&](const auto& group) { return group.id != flags.group; });
    if (groups.empty())
      throw InputError(
          gallery.path(),
          fmt::format("there is no group {}: `people groups` lists them", flags.group));
    list_sightings(gallery, flags, context);
    return ExitStatus::kDone;
  }
  std::erase_if(groups, [&](const auto& group) { return group.sightings < flags.min_sightings; });
  for (const auto& group : groups) {
    if (context.json) {
      print_json({{"group", group.id},
                  {"sightings", group.sightings},
                  {"first", time_text(group.first_time)},
                  {"last", time_text(group.last_time)}});
    } else {
      print_text(fmt::format("group {:<6} {:>5} {}  {} to {}\n", group.id, group.sightings,
                             group.sightings == 1 ? "sighting " : "sightings",
                             time_text(group.first_time).substr(0, 19),
                             time_text(group.last_time).substr(0, 19)));
    }
  }
  if (const auto waiting = gallery.ungrouped_count(); waiting > 0)
    log_info("{} unknown faces are in no group yet: `people group` places them", waiting);
  if (!flags.draw.empty() && !groups.empty()) draw_groups(gallery, groups, flags.draw);
  return groups.empty() ? ExitStatus::kNothingFound : ExitStatus::kDone;
}

struct NameFlags {
  PeopleFlags people;
  int group = 0;
  std::string name;
  std::string note;
  std::int64_t max_faces = 20;
};

ExitStatus name_group(const NameFlags& flags, Context& context) {
  // A wrong path is reported before anything is written.
  if (!flags.people.background.empty()) static_cast<void>(find_background(flags.people));
  face::people::Gallery gallery = face::open_gallery_to_write(flags.people.gallery);
  const std::int64_t id =
      gallery.name_group(flags.group, flags.name, flags.note, flags.max_faces, correction_stamp());
  const auto person = gallery.find(flags.name);
  const auto entry = gallery.correction(id);
  if (context.json) {
    print_json({{"correction", id},
                {"name", flags.name},
                {"group", flags.group},
                {"faces", person ? person->faces : 0}});
  } else {
    print_text(fmt::format(
        "group {} is {}: {} faces enrolled. Correction {}: undo it with `people correct undo {}`\n",
        flags.group, printable(flags.name), person ? person->faces : 0, id, id));
  }
  // Prepares the model for the next verb.
  (void)model_of_gallery(gallery, flags.people, context);
  return ExitStatus::kDone;
}

void add_group_flags(Command& verb, GroupFlags& flags) {
  verb.add_option("GALLERY,--gallery", flags.people.gallery, "gallery file: the enrolled people")
      .show_default();
  bind_field(verb, flags.grouping, flags.grouping.false_merges);
  add_template_flags(verb, flags.people);
}

void add_groups_flags(Command& verb, GroupsFlags& flags) {
  add_gallery_flag(verb, flags.people);
  verb.add_option("--group", flags.group, "list the sightings of this group only [all groups]")
      .check(at_least(1));
  verb.add_option("--min-sightings", flags.min_sightings,
                  "list only groups of at least this many sightings")
      .check(at_least(1))
      .show_default();
  verb.add_option(
      "--draw", flags.draw,
      "write an image of the best faces, one row a group; with --group of all its faces");
}

void add_name_flags(Command& verb, NameFlags& flags) {
  verb.add_option("GROUP", flags.group, "number of the group, as `people groups` shows it")
      .required()
      .check(at_least(1));
  verb.add_option("NAME", flags.name,
                  "name of the person, UTF-8, at most 200 bytes; an existing person gets the faces")
      .required();
  add_gallery_flag(verb, flags.people);
  verb.add_option("--note", flags.note, "note on the consent: who agreed to what, and when");
  verb.add_option("--faces", flags.max_faces, "maximum number of faces to enrol, best first")
      .check(range(1, 1000))
      .show_default();
  add_template_flags(verb, flags.people);
}

}  // namespace

void add_people_groups(Command& area, Context& context) {
  add_verb<GroupFlags>(
      area, "group",
      "group the unknown faces stored by `people identify --keep`, one group a person", context,
      add_group_flags, group_faces);
  add_verb<GroupsFlags>(area, "groups", "list the groups of unknown faces", context,
                        add_groups_flags, list_groups);
  add_verb<NameFlags>(area, "name", "name a group of unknown faces and enrol it", context,
                      add_name_flags, name_group);
}

}  // namespace tarsier::cli
