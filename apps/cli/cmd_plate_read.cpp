// SPDX-License-Identifier: MIT
#include "tarsier/plate/reading_json.h"
#include "tarsier/plate_video/log.h"
#include "tarsier/session/plate_session.h"

#include <fmt/format.h>

#include "cmd_plate.h"
#include "plate_engine.h"
#include "run_session.h"
#include <chrono>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace tarsier::cli {
namespace {

using Clock = std::chrono::steady_clock;

struct ReadFlags {
  RunFlags run;
  PlateFlags plate;
  plate::TrackerOptions tracker;
  std::string region;
  std::string log;
  bool events_only = false;
};

void print_reading(const Frame& frame, const plate::Reading& reading) {
  print_text(fmt::format("{}: {} {:.2f}{}{} [{},{} {}x{}]\n", frame.name,
                         reading.text.empty() ? "(unreadable)" : reading.text, reading.confidence,
                         reading.country.empty() ? "" : " ", reading.country, reading.box.x,
                         reading.box.y, reading.box.width, reading.box.height));
}

void print_event(const plate::PlateEvent& event) {
  print_text(fmt::format("{:.1f}-{:.1f} s: {} {:.2f}{}{} ({} {})\n", event.first_time,
                         event.last_time, event.text, event.confidence,
                         event.country.empty() ? "" : " ", event.country, event.frames,
                         event.frames == 1 ? "frame" : "frames"));
}

plate::Moment moment_of_zero(double time) {
  return plate::moment_now() -
         std::chrono::duration_cast<plate::Moment::duration>(std::chrono::duration<double>(time));
}

ExitStatus run_read(ReadFlags& flags, Context& context) {
  if (!flags.region.empty()) flags.tracker.region = plate::parse_region(flags.region);
  flags.tracker.check();
  // Without a picture wanted, the readings are the output.
  if (flags.run.output.empty() && !flags.run.window && !flags.run.fullscreen)
    flags.run.output = "none";
  const PlateReader read = make_plate_reader(flags.plate, context);
  std::optional<plate::PlateLog> log;
  if (!flags.log.empty()) log.emplace(flags.log);
  DebugFolder debug(context.debug_dir);

  double milliseconds = 0;
  bool found = false;
  std::string source;
  std::optional<plate::Moment> origin;  // when the source's time was 0
  const auto read_frame = [&](const Frame& frame) {
    if (!origin || frame.still || source != frame.name)
      origin = moment_of_zero(frame.still ? 0 : frame.time);
    source = frame.name;
    const Clock::time_point start = Clock::now();
    std::vector<plate::Reading> readings = read(frame, debug.sink());
    milliseconds = std::chrono::duration<double, std::milli>(Clock::now() - start).count();
    return readings;
  };
  const auto on_plate = [&](const plate::PlateEvent& event) {
    found = true;
    if (log) (void)log->append(event, source, *origin);
    if (context.json)
      print_json_line(
          event_json(event).dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
    else
      print_event(event);
  };
  PlateSession session(read_frame, on_plate, flags.tracker);
  // A still has no vehicle that comes and goes: what is read in it is logged as it is.
  const auto finish_still = [&](const Frame& frame) {
    for (const plate::Reading& reading : session.readings()) {
      if (!context.json) print_reading(frame, reading);
      if (log && !reading.text.empty())
        (void)log->append(plate::event_of(reading, frame.image), frame.name, *origin);
    }
  };

  RunHooks hooks;
  hooks.title = "plates";
  hooks.debug = &debug;
  hooks.after_frame = [&](const Frame& frame) {
    found = found || ((frame.still || !flags.events_only) && !session.readings().empty());
    if (frame.still) finish_still(frame);
  };
  hooks.describe = [&](const View&, nlohmann::ordered_json& line) {
    nlohmann::ordered_json plates = nlohmann::ordered_json::array();
    for (const plate::Reading& reading : session.readings())
      plates.push_back(reading_json(reading));
    line["plates"] = std::move(plates);
    line["ms"] = std::round(milliseconds * 100) / 100;
    if (session.tracks().empty()) return;
    nlohmann::ordered_json tracks = nlohmann::ordered_json::array();
    for (const plate::LiveTrack& track : session.tracks()) {
      tracks.push_back({{"id", track.id},
                        {"text", track.text},
                        {"confidence", std::round(track.confidence * 1e4) / 1e4},
                        {"box", {track.box.x, track.box.y, track.box.width, track.box.height}},
                        {"confirmed", track.confirmed}});
    }
    line["tracks"] = std::move(tracks);
  };
  hooks.quiet_frames = flags.events_only;
  ExitStatus status = ExitStatus::kDone;
  try {
    status = run_session(session, flags.run, context, hooks);
  } catch (...) {
    session.finish();  // what was seen before the source broke
    throw;
  }
  session.finish();
  return status == ExitStatus::kDone && !found ? ExitStatus::kNothingFound : status;
}

}  // namespace

void add_plate_read(CLI::App& plate, Context& context) {
  auto flags = std::make_shared<ReadFlags>();
  CLI::App& verb = *plate.add_subcommand("read", "reads the plates of pictures, films and cameras");
  add_run_flags(verb, flags->run);
  add_plate_flags(verb, flags->plate);
  const auto film = [](CLI::Option* option) { option->group("Films and cameras"); };
  film(verb.add_option("--roi", flags->region,
                       "only plates whose centre is in x,y,w,h or a polygon 'x,y x,y x,y'; px, or "
                       "shares of the picture where no number is above 1"));
  film(verb.add_flag("--events", flags->events_only, "JSON: only events, no line for each frame"));
  film(verb.add_option("--lost-after", flags->tracker.lost_after,
                       "s without a reading after which a vehicle is out of sight")
           ->capture_default_str());
  film(verb.add_option("--return-within", flags->tracker.return_within,
                       "s in which the same text is the same vehicle, come back")
           ->capture_default_str());
  film(verb.add_option("--parked-return-within", flags->tracker.parked_return_within,
                       "s, the same of one that stood still")
           ->capture_default_str());
  film(verb.add_option("--least-readings", flags->tracker.least_readings,
                       "frames in which a vehicle must be read")
           ->capture_default_str());
  film(verb.add_flag("--words", flags->tracker.words,
                     "texts without a digit are vehicles too (a few plates; many signs)"));
  film(verb.add_option("--log", flags->log, "SQLite file that every vehicle is written to"));
  add_common_flags(verb, context);
  add_debug_flag(verb, context);
  verb.callback(
      [flags, &context] { context.run = [flags, &context] { return run_read(*flags, context); }; });
}

}  // namespace tarsier::cli
