// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/face/people/export.h"
#include "tarsier/plate/tracking/time_text.h"

#include <fmt/format.h>

#include "verbs/people/engine.h"
#include "verbs/people/images.h"
#include "verbs/people/people.h"
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <unistd.h>

namespace tarsier::cli {
namespace {

struct GalleryFlags {
  PeopleFlags people;
  bool sightings = false;
  std::int64_t limit = 0;
  std::string keep;
  std::string name;
  std::string faces_of;
  std::string draw;
  int group = 0;
  bool yes = false;
  std::string output;
};

ExitStatus list_faces(face::people::Gallery& gallery, const GalleryFlags& flags,
                      const Context& context) {
  const std::string& name = flags.faces_of;
  const auto person = gallery.find(name);
  if (!person)
    throw InputError(
        gallery.path(),
        fmt::format("nobody is enrolled as '{}': `people list` lists them", printable(name)));
  FaceSheet sheet(flags.draw);
  gallery.each_face(person->id, sheet.is_drawn(), [&](face::people::StoredFace&& face) {
    nlohmann::ordered_json line = {{"face", face.id},
                                   {"name", name},
                                   {"time", time_text(face.time)},
                                   {"quality", rounded(face.quality, 3)},
                                   {"source", face.source}};
    sheet.add(face.crop, face.id, line);
    if (context.json) {
      print_json(line);
    } else {
      print_text(fmt::format("{:>6}  {}  quality {:.2f}  {}\n", face.id,
                             time_text(face.time).substr(0, 19), face.quality,
                             printable(face.source)));
    }
  });
  sheet.write();
  return person->faces > 0 ? ExitStatus::kDone : ExitStatus::kNothingFound;
}

ExitStatus list_people(const GalleryFlags& flags, const Context& context) {
  if (!flags.keep.empty()) {
    const auto age = plate::parse_duration(flags.keep, "--keep");
    face::people::Gallery gallery = face::open_gallery_to_write(flags.people.gallery);
    const std::int64_t deleted = gallery.forget_sightings_before(now_ms() - age.count());
    const std::int64_t remaining = gallery.sighting_count();
    if (context.json) {
      print_json({{"deleted", deleted}, {"kept", remaining}});
    } else {
      print_text(fmt::format("{} sightings deleted, {} kept\n", deleted, remaining));
    }
    return ExitStatus::kDone;
  }
  // Opened for writing if possible, so that an older gallery is upgraded.
  face::people::Gallery gallery = face::open_gallery(flags.people.gallery);
  if (flags.sightings) {
    const auto sightings = gallery.sightings(flags.limit);
    for (const face::people::Sighting& s : sightings) {
      if (context.json) {
        print_json(
            {{"id", s.id},
             {"time", time_text(s.time)},
             {"source", s.source},
             {"label", s.name.empty() ? nlohmann::ordered_json() : nlohmann::ordered_json(s.name)},
             {"known", s.known},
             {"confidence", s.confidence},
             {"face", s.has_face},
             {"group", s.group > 0 ? nlohmann::ordered_json(s.group) : nlohmann::ordered_json()}});
      } else {
        print_text(
            fmt::format("{:>6}  {}  {:<24} {:>5}  {}\n", s.id, time_text(s.time).substr(0, 19),
                        s.known       ? printable(s.name)
                        : s.group > 0 ? fmt::format("unknown, group {}", s.group)
                                      : std::string("unknown"),
                        // A group that a user named.
                        s.known && s.confidence < 0.5 ? std::string("named")
                                                      : fmt::format("{:.0f} %", 100 * s.confidence),
                        printable(s.source)));
      }
    }
    return sightings.empty() ? ExitStatus::kNothingFound : ExitStatus::kDone;
  }
  if (!flags.faces_of.empty()) return list_faces(gallery, flags, context);
  const auto people = gallery.people();
  for (const face::people::Person& person : people) {
    if (context.json) {
      print_json({{"name", person.name},
                  {"faces", person.faces},
                  {"note", person.note},
                  {"time", time_text(person.time)}});
    } else {
      print_text(fmt::format("{:<24} {:>4} faces  since {}  {}\n", printable(person.name),
                             person.faces, time_text(person.time).substr(0, 10),
                             printable(person.note)));
    }
  }
  if (people.empty()) log_info("{}: nobody is enrolled", flags.people.gallery);
  return people.empty() ? ExitStatus::kNothingFound : ExitStatus::kDone;
}

// Asks the user, which needs a terminal.
bool confirmed_by_user(const std::string& name, const std::string& what) {
  if (isatty(STDIN_FILENO) == 0)
    throw UsageError("forgetting cannot be undone: without a terminal, confirm it with --yes");
  print_text(fmt::format("Forget '{}' with {} for good? [y/N] ", printable(name), what));
  const int answer = std::getchar();
  return answer == 'y' || answer == 'Y';
}

std::string_view index_word(face::people::IndexOutcome outcome) {
  switch (outcome) {
    case face::people::IndexOutcome::kKept:
      return "kept";
    case face::people::IndexOutcome::kRewritten:
      return "rewritten";
    case face::people::IndexOutcome::kDeleted:
      return "deleted";
    case face::people::IndexOutcome::kNone:
      break;
  }
  return "none";
}

// What was removed, how far copies were searched for, and what could not be proven.
std::string forget_text(const std::string& name, const face::people::ForgetReport& report) {
  const face::people::SearchReport& search = report.search;
  std::string text = fmt::format(
      "{} is forgotten: {} faces, {} sightings{}.\nSearched {} files in {} folders, {} bytes, for "
      "{} "
      "of {} pieces of 32 bytes of the removed crops and templates: {}\n",
      printable(name), report.person.faces, report.sightings,
      report.model_removed ? ", and what was learned from them" : "", search.files.size(),
      search.folders, search.bytes, report.searched_pieces, report.total_pieces,
      report.proven() ? "none is left." : "NOT PROVEN.");
  if (report.index == face::people::IndexOutcome::kRewritten)
    text += "The index was written again, without them.\n";
  if (report.index == face::people::IndexOutcome::kDeleted)
    text += "The index is deleted: build a new one with `people index`.\n";
  if (report.shared_pieces > 0) {
    std::string others;
    for (const std::string& other : report.shared_with)
      others += (others.empty() ? "'" : ", '") + printable(other) + "'";
    text += fmt::format(
        "{} pieces also occur in faces of {}, who stay enrolled: they were not searched for.\n",
        report.shared_pieces, others);
  }
  if (report.unproven_records > 0) {
    text += fmt::format(
        "{} crops and templates could mostly not be searched for: their deletion is not "
        "verified{}.\n",
        report.unproven_records,
        report.shared_pieces > 0 ? " (the same image is there under another name)" : "");
  }
  if (search.links > 0) text += fmt::format("{} links were not followed.\n", search.links);
  for (const std::string& skipped : search.skipped)
    text += fmt::format("not searched: {}\n", printable(skipped));
  return text;
}

ExitStatus report_deletion(const face::people::Gallery& gallery, const std::string& name,
                           const face::people::ForgetReport& report, const GalleryFlags& flags,
                           const Context& context) {
  const face::people::SearchReport& search = report.search;
  if (context.json) {
    print_json({{"name", name},
                {"faces", report.person.faces},
                {"sightings", report.sightings},
                {"unlearned", report.model_removed},
                {"index", index_word(report.index)},
                {"pieces", report.total_pieces},
                {"pieces_searched", report.searched_pieces},
                {"pieces_shared", report.shared_pieces},
                {"shared_with", report.shared_with},
                {"unproven", report.unproven_records},
                {"searched", search.files},
                {"folders", search.folders},
                {"bytes", search.bytes},
                {"links", search.links},
                {"left_in", search.files_with_pieces},
                {"unread", search.unreadable},
                {"skipped", search.skipped},
                {"proven", report.proven()}});
  } else {
    print_text(forget_text(name, report));
  }
  if (!report.log_emptied) {
    throw OutputError(gallery.path(),
                      "another program still uses it: its log could not be emptied; end that "
                      "program and open the gallery once more");
  }
  if (!search.files_with_pieces.empty()) {
    throw OutputError(search.files_with_pieces.front(),
                      "still holds pieces of the removed faces (a copy or export?): delete it");
  }
  if (!search.unreadable.empty())
    throw OutputError(search.unreadable.front(), "could not be searched");
  if (!report.gallery_searched)
    throw OutputError(gallery.path(), "was moved meanwhile and could not be searched");
  if (!search.skipped.empty()) {
    throw OutputError(
        flags.people.gallery,
        "the person is removed, but some files in its folder could not be searched: " +
            printable(search.skipped.front()));
  }
  return ExitStatus::kDone;
}

ExitStatus forget_group(face::people::Gallery& gallery, const GalleryFlags& flags,
                        const Context& context) {
  const auto group = gallery.group(flags.group);
  const std::string name = fmt::format("group {}", flags.group);
  if (!group) {
    log_warning("{}: there is no {}", flags.people.gallery, name);
    return ExitStatus::kNothingFound;
  }
  if (!flags.yes && !confirmed_by_user(name, fmt::format("{} sightings", group->sightings)))
    return ExitStatus::kNothingFound;
  const auto report = gallery.forget_group(flags.group, context.stop);
  if (!report) return ExitStatus::kNothingFound;
  return report_deletion(gallery, name, *report, flags, context);
}

// A name that is not enrolled may still be in the log of corrections.
ExitStatus forget_log_entries(face::people::Gallery& gallery, const GalleryFlags& flags,
                              const Context& context) {
  if (!gallery.is_in_log(flags.name)) {
    log_warning("{}: nobody is enrolled as '{}'", flags.people.gallery, printable(flags.name));
    return ExitStatus::kNothingFound;
  }
  if (!flags.yes && !confirmed_by_user(flags.name, "the corrections that name them"))
    return ExitStatus::kNothingFound;
  const std::int64_t entries = gallery.forget_in_log(flags.name);
  if (context.json) {
    print_json({{"name", flags.name}, {"faces", 0}, {"log_entries", entries}});
  } else {
    print_text(fmt::format("Nobody is enrolled as '{}'; {} correction{} deleted from the log\n",
                           printable(flags.name), entries, entries == 1 ? "" : "s"));
  }
  return ExitStatus::kDone;
}

ExitStatus forget_person(const GalleryFlags& flags, Context& context) {
  face::people::Gallery gallery = face::open_gallery_to_write(flags.people.gallery);
  if (flags.name.empty() == (flags.group == 0))
    throw UsageError("give NAME, or --group of unknown faces");
  if (flags.group > 0) return forget_group(gallery, flags, context);
  const auto person = gallery.find(flags.name);
  if (!person) return forget_log_entries(gallery, flags, context);
  if (!flags.yes && !confirmed_by_user(person->name, fmt::format("{} faces", person->faces)))
    return ExitStatus::kNothingFound;
  const auto report = gallery.forget(flags.name, context.stop);
  if (!report) return ExitStatus::kNothingFound;
  return report_deletion(gallery, flags.name, *report, flags, context);
}

ExitStatus export_people(const GalleryFlags& flags, Context& context) {
  face::people::Gallery gallery = face::open_gallery(flags.people.gallery);
  const auto report = face::people::export_gallery(gallery, flags.output, time_text, context.stop);
  if (context.json) {
    print_json({{"output", flags.output}, {"people", report.people}, {"faces", report.faces}});
  } else {
    print_text(fmt::format("{} people, {} faces written to {}\n", report.people, report.faces,
                           printable(flags.output)));
  }
  return report.people > 0 ? ExitStatus::kDone : ExitStatus::kNothingFound;
}

void add_list_flags(Command& verb, GalleryFlags& flags) {
  add_gallery_flag(verb, flags.people);
  Flag& sightings =
      verb.add_flag("--sightings", flags.sightings, "list the sightings, newest first");
  Flag& faces = verb.add_option("--faces", flags.faces_of,
                                "list the enrolled faces of this person, with their numbers");
  faces.excludes(sightings);
  verb.add_option("--draw", flags.draw, "write an image of these faces with their numbers")
      .needs(faces);
  verb.add_option("--limit", flags.limit, "maximum number of sightings, newest first; 0: all")
      .check(at_least(0))
      .show_default();
  verb.add_option("--keep", flags.keep, "delete sightings older than this: 30d, 12h, 90m ..")
      .excludes(sightings);
}

void add_forget_flags(Command& verb, GalleryFlags& flags) {
  verb.add_option("NAME", flags.name, "name as `people list` shows it");
  verb.add_option("--group", flags.group,
                  "forget a group of unknown faces instead of a person [none]")
      .check(at_least(1));
  add_gallery_flag(verb, flags.people);
  verb.add_flag("--yes", flags.yes, "do not ask for confirmation");
}

void add_export_flags(Command& verb, GalleryFlags& flags) {
  verb.add_option("-o,--output", flags.output, "output folder; must not exist").required();
  add_gallery_flag(verb, flags.people);
}

}  // namespace

void add_people_gallery(Command& area, Context& context) {
  add_verb<GalleryFlags>(area, "list", "list the enrolled people, or the sightings", context,
                         add_list_flags, list_people);
  add_verb<GalleryFlags>(
      area, "forget",
      "delete a person for good and confirm it by searching all files of the gallery's folder",
      context, add_forget_flags, forget_person);
  add_verb<GalleryFlags>(area, "export", "export the whole gallery: faces, faces.lst, people.json",
                         context, add_export_flags, export_people);
}

}  // namespace tarsier::cli
