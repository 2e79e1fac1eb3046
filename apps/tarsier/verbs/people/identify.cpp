// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/plate/tracking/time_text.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/on_event.h"
#include "framework/run_session.h"
#include "ui/face/recognize_session.h"
#include "verbs/people/engine.h"
#include "verbs/people/people.h"
#include "verbs/people/recognition_events.h"
#include "verbs/people/sightings.h"
#include <chrono>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace tarsier::cli {
namespace {

struct IdentifyFlags {
  RunFlags run;
  PeopleFlags people;
  face::IdentificationOptions identification;
  std::string model;
  bool raw = false;
  OnEventFlags on_event;
  PublishFlags publish;
  std::string keep;
  std::string csv;
};

ExitStatus identify_faces(IdentifyFlags& flags, Context& context) {
  default_to_headless(flags.run);
  if (flags.raw && flags.model.empty()) throw UsageError("--raw needs --model");
  if (!flags.keep.empty() && !flags.model.empty())
    throw UsageError("--keep needs a gallery, not --model");
  face::IdentifierOptions options = identifier_options(flags.people);
  options.write_gallery = !flags.keep.empty();
  options.recognizer = flags.model;
  options.cropped = flags.raw;
  options.identification = flags.identification;
  std::optional<std::chrono::milliseconds> keep;
  if (!flags.keep.empty()) keep = plate::parse_duration(flags.keep, "--keep");
  const face::Identifier identifier = load_identifier(options);
  face::IdentifierState state = identifier.open(*context.progress, context.stop);
  if (state.recognizer() == nullptr) log_info("{}: nobody is enrolled", flags.people.gallery);
  face::people::Gallery* const gallery = state.gallery();
  std::optional<SightingWriter> sightings;
  if (keep) sightings.emplace(*gallery, keep->count());
  DebugFolder debug(context.debug_dir);
  RecognizeSession session(identifier, std::move(state), debug.sink());
  OnEvent on_event(flags.on_event, context, flags.publish, http_access(flags.run));
  RecognitionEvents events(on_event);
  bool known = false;
  RunHooks hooks;
  hooks.title = "people";
  hooks.debug = &debug;
  hooks.table = {flags.csv, kFaceColumns};
  hooks.rows = [&](const Frame& frame) { return face_rows(frame, session.faces()); };
  hooks.after_frame = [&](const Frame& frame) {
    events.frame(frame, session.faces());
    if (sightings) sightings->frame(frame, session.faces(), now_ms());
    for (const face::IdentifiedFace& face : session.faces()) known = known || face.identity.known;
    if (!frame.still || context.json || context.quiet) return;
    std::string text = fmt::format("{}:", printable(frame.name));
    for (const face::IdentifiedFace& face : session.faces()) {
      if (!face.face.trusted) text += " uncertain face:";
      text += face.identity.known ? fmt::format(" {} ({:.0f} %)", printable(face.identity.label),
                                                100 * face.identity.confidence)
              : face.identity.label.empty()
                  ? " unknown"
                  : fmt::format(" unknown (nearest: {}, {:.0f} %)", printable(face.identity.label),
                                100 * face.identity.confidence);
    }
    print_text(text + (session.faces().empty() ? " no face\n" : "\n"));
  };
  hooks.describe = [&](const View&, nlohmann::ordered_json& line) {
    line.update(to_json(session.result()));
  };
  const ExitStatus status = run_session(session, flags.run, context, hooks);
  if (sightings) sightings->finish();
  on_event.finish();
  return status == ExitStatus::kDone && !known ? ExitStatus::kNothingFound : status;
}

void add_flags(Command& verb, IdentifyFlags& flags) {
  add_run_flags(verb, flags.run);
  add_gallery_flag(verb, flags.people);
  verb.add_option("--model", flags.model,
                  "model of `people train -o` to use instead of the gallery");
  verb.add_flag("--raw", flags.raw, "the images are face crops already");
  bind_field(verb, flags.identification, flags.identification.false_accepts);
  verb.add_option(
      "--csv", flags.csv,
      "CSV file: frame, time, image, face, nearest person, confidence, known, box (px)");
  add_on_event_flags(verb, flags.on_event, "at each new recognition");
  add_publish_flags(verb, flags.publish, "person");
  verb.add_option(
      "--keep", flags.keep,
      "store sightings with their faces in the gallery; delete older ones: 30d, 12h ..");
  add_face_flags(verb, flags.people);
}

}  // namespace

void add_people_identify(Command& area, Context& context) {
  add_debug_flag(
      add_verb<IdentifyFlags>(area, "identify", "identify the faces in images, videos and cameras",
                              context, add_flags, identify_faces),
      context);
}

}  // namespace tarsier::cli
