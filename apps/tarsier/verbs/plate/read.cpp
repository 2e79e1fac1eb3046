// SPDX-License-Identifier: MIT
#include "tarsier/core/csv.h"
#include "tarsier/plate/reader/video_reader.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/run_session.h"
#include "ui/plate/plate_session.h"
#include "verbs/plate/engine.h"
#include "verbs/plate/plate.h"
#include "verbs/plate/reports.h"
#include "verbs/plate/site.h"
#include <chrono>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::cli {
namespace {

struct ReadFlags {
  RunFlags run;
  PlateFlags plate;
  plate::TrackerOptions tracker;
  std::string region;
  ReportFlags reports;
  SiteFlags site;
  bool events_only = false;
  std::string csv;
};

// Columns of --csv: one row per plate and frame.
constexpr const char* kPlateColumns = "frame,time,image,text,confidence,country,x,y,width,height";

std::string row_of(const Frame& frame, const plate::Reading& reading) {
  return fmt::format("{},{},{:.4f},{},{},{},{},{}", frame_cells(frame), csv_field(reading.text),
                     reading.confidence, csv_field(reading.country), reading.box.x, reading.box.y,
                     reading.box.width, reading.box.height);
}

ExitStatus run_read(ReadFlags& flags, Context& context) {
  if (!flags.region.empty()) flags.tracker.region = plate::parse_region(flags.region);
  flags.tracker.check();
  const std::vector<NamedSource> cameras = site_cameras(flags.run);
  if (!cameras.empty()) {
    if (!flags.csv.empty())
      throw UsageError("--csv needs a single source; for several cameras use --log");
    if (!context.debug_dir.empty()) throw UsageError("--debug-dir needs a single source");
    return read_site(cameras, flags.site, flags.run, flags.plate, flags.tracker, flags.reports,
                     context);
  }
  check_no_site_flags(flags.site);
  // If no image is requested, the readings are the output.
  default_to_headless(flags.run);
  plate::VideoReader reader = plate::VideoReader::load(
      ModelStore::find(), {reader_options(flags.plate, context), flags.tracker});
  PlateReports reports(flags.reports, flags.run, context);
  DebugFolder debug(context.debug_dir);
  bool found = false;
  UnsuitablePlateCounter unfit;
  PlateSession session(
      std::move(reader), [&](const plate::PlateEvent& event) { reports.report_vehicle(event); },
      [&](const Frame& frame) { return reports.moment_of(frame); }, debug.sink());
  reports.on_step([&](std::chrono::milliseconds by) { session.shift_unsynchronized(by); });

  RunHooks hooks;
  hooks.title = "plates";
  hooks.debug = &debug;
  hooks.after_frame = [&](const Frame& frame) {
    found = found || ((frame.still || !flags.events_only) && !session.readings().empty());
    if (frame.still) reports.report_still(frame, session.readings());
    unfit.add(session.readings());
    reports.check();
  };
  hooks.describe = [&](const View&, nlohmann::ordered_json& line) {
    line.update(to_json(session.result()));
  };
  hooks.quiet_frames = flags.events_only;
  hooks.table = {flags.csv, kPlateColumns};
  hooks.rows = [&](const Frame& frame) {
    std::vector<std::string> rows;
    for (const plate::Reading& reading : session.readings()) rows.push_back(row_of(frame, reading));
    return rows;
  };
  ExitStatus status = ExitStatus::kDone;
  try {
    status = run_session(session, flags.run, context, hooks);
  } catch (...) {
    session.finish();  // events from before the source failed
    reports.finish(true);
    throw;
  }
  session.finish();
  reports.finish(status == ExitStatus::kInterrupted);
  unfit.warn(flags.plate.reader.countries);
  return status == ExitStatus::kDone && !found && !reports.has_closed_events()
             ? ExitStatus::kNothingFound
             : status;
}

void add_flags(Command& verb, ReadFlags& flags) {
  add_run_flags(verb, flags.run);
  add_plate_flags(verb, flags.plate);
  verb.add_option("--csv", flags.csv,
                  "CSV file: frame, time, image, text, confidence, country, box (px)");
  const auto video = [](Flag& flag) { flag.group("Videos and cameras"); };
  video(verb.add_option("--roi", flags.region,
                        "keep only plates whose centre is in x,y,w,h or polygon 'x,y x,y x,y'; px, "
                        "or shares if all <= 1"));
  video(verb.add_flag("--events", flags.events_only, "JSON: write only events, no frames"));
  bind_all(verb, flags.tracker, "Videos and cameras");
  add_report_flags(verb, flags.reports);
  add_site_flags(verb, flags.site);
}

}  // namespace

void add_plate_read(Command& plate, Context& context) {
  add_debug_flag(add_verb<ReadFlags>(plate, "read", "read plates in images, videos and cameras",
                                     context, add_flags, run_read),
                 context);
}

}  // namespace tarsier::cli
