// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/time_text.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/on_event.h"
#include "framework/run_session.h"
#include "ui/face/people_session.h"
#include "verbs/people/engine.h"
#include "verbs/people/people.h"
#include "verbs/people/recognition_events.h"
#include "verbs/people/sightings.h"
#include <chrono>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

namespace tarsier::cli {
namespace {

struct LiveFlags {
  RunFlags run;
  PeopleFlags people;
  PeopleSessionOptions session;
  std::string algorithm;
  std::string keep;
  std::string csv;
  OnEventFlags on_event;
  PublishFlags publish;
};

ExitStatus live(LiveFlags& flags, Context& context) {
  face::IdentifierOptions options = identifier_options(flags.people);
  options.enroll = true;
  if (!flags.algorithm.empty()) {
    try {
      options.algorithm = face::recognition::parse_algorithm(flags.algorithm);
    } catch (const std::invalid_argument& error) {
      throw UsageError(fmt::format("--algorithm: {}", error.what()));
    }
  }
  std::optional<std::chrono::milliseconds> keep;
  if (!flags.keep.empty()) keep = plate::parse_duration(flags.keep, "--keep");
  flags.session.now = now_ms;
  flags.session.actor = correction_stamp().actor;
  DebugFolder debug(context.debug_dir);
  // Pending learning of an existing gallery is done before the window opens.
  PeopleSession session(load_identifier(options).open(*context.progress, context.stop),
                        flags.session, debug.sink());
  std::optional<SightingWriter> sightings;
  if (keep) sightings.emplace(session.gallery(), keep->count());
  OnEvent on_event(flags.on_event, context, flags.publish, http_access(flags.run));
  RecognitionEvents events(on_event);
  RunHooks hooks;
  hooks.title = "people";
  hooks.debug = &debug;
  hooks.table = {flags.csv, kFaceColumns};
  hooks.rows = [&](const Frame& frame) { return face_rows(frame, session.faces()); };
  hooks.after_frame = [&](const Frame& frame) {
    // Faces are not identified while faces are collected or learned. If nobody is enrolled, all
    // faces are unknown.
    const bool names = session.mode() == PeopleMode::kRecognize;
    if (!names && session.mode() != PeopleMode::kDetect) return;
    if (names) events.frame(frame, session.faces());
    if (!sightings) return;
    sightings->frame(frame, session.faces(), now_ms());
    if (frame.still) session.count_unknown();
    for (const face::IdentifiedFace& face : session.faces())
      if (const std::int64_t id = sightings->sighting_of(face.face.id); id > 0)
        session.on_sighting_stored(face.face.id, id);
  };
  hooks.describe = [&](const View& view, nlohmann::ordered_json& line) {
    line["faces"] = nlohmann::ordered_json::array();
    for (std::size_t i = 0; i < session.faces().size(); ++i) {
      const face::IdentifiedFace& face = session.faces()[i];
      const std::int64_t group = i < session.groups().size() ? session.groups()[i] : 0;
      nlohmann::ordered_json object = to_json(face);
      object["id"] = face.face.id;
      object["group"] = group > 0 ? nlohmann::ordered_json(group) : nlohmann::ordered_json();
      line["faces"].push_back(std::move(object));
    }
    line["mode"] = view.state["mode"];
    line["people"] = view.state["people"];
    line["unknown"] = view.state["unknown"];
    line["message"] = view.state["message"];
    line["ms"] = rounded(session.milliseconds(), 2);
  };
  const ExitStatus status = run_session(session, flags.run, context, hooks);
  if (sightings) sightings->finish();
  on_event.finish();
  return status;
}

void add_flags(Command& verb, LiveFlags& flags) {
  add_run_flags(verb, flags.run);
  add_gallery_flag(verb, flags.people);
  verb.add_option("--names", flags.session.names,
                  "names of the people to add, in turn; then Person 1, Person 2 ..")
      .delimiter(',');
  verb.add_option("--note", flags.session.note, "note on the consent of the people to add");
  verb.add_option(
      "--keep", flags.keep,
      "store sightings with their faces in the gallery; delete older ones: 30d, 12h ..");
  verb.add_option(
      "--csv", flags.csv,
      "CSV file: frame, time, image, face, nearest person, confidence, known, box (px)");
  add_on_event_flags(verb, flags.on_event, "at each new recognition");
  add_publish_flags(verb, flags.publish, "person");
  verb.add_option("--algorithm", flags.algorithm,
                  "algorithm: default, eigen, fisher, lbph or deep");
  bind_field(verb, flags.session, flags.session.max_faces);
  bind_field(verb, flags.session, flags.session.false_accepts);
  face::people::CollectOptions& collect = flags.session.collect;
  bind_field(verb, collect, collect.min_seconds, {}, "s, minimum time between two faces taken");
  bind_field(verb, collect, collect.min_difference, {},
             "minimum difference from the last face taken");
  add_face_flags(verb, flags.people);
}

}  // namespace

void add_people_live(Command& area, Context& context) {
  add_debug_flag(add_verb<LiveFlags>(
                     area, "live",
                     "enrol and identify in a window: click Add Person, click elsewhere to train",
                     context, add_flags, live),
                 context);
}

}  // namespace tarsier::cli
