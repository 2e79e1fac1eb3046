// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/media/still_source.h"
#include "tarsier/plate/reader/video_reader.h"
#include "tarsier/plate/tracking/log.h"
#include "tarsier/plate/tracking/recorder.h"
#include "tarsier/plate/tracking/source_clock.h"
#include "tarsier/plate/tracking/watch.h"
#include "tarsier/synth/sources.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/on_event.h"
#include "framework/publish.h"
#include "framework/run_session.h"
#include "ui/plate/plate_session.h"
#include "verbs/plate/engine.h"
#include "verbs/plate/plate.h"
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <sys/stat.h>
#include <utility>
#include <vector>

namespace tarsier::cli {
namespace {

struct ReadFlags {
  RunFlags run;
  PlateFlags plate;
  plate::TrackerOptions tracker;
  std::string region;
  std::string log;
  std::string start;
  OnEventFlags on_event;
  std::string watch;
  bool on_watch = false;
  PublishFlags publish;
  bool events_only = false;
};

std::string watched_text(const std::optional<plate::WatchMatch>& match) {
  if (!match) return {};
  const std::string& label = match->entry->label;
  return fmt::format(" watched: {}{}{}", match->entry->plate, label.empty() ? "" : " ",
                     printable(label));
}

void print_reading(const Frame& frame, const plate::Reading& reading,
                   const std::optional<plate::WatchMatch>& match) {
  print_text(fmt::format("{}: {} {:.2f}{}{} [{},{} {}x{}]{}\n", frame.name,
                         reading.text.empty() ? "(unreadable)" : reading.text, reading.confidence,
                         reading.country.empty() ? "" : " ", reading.country, reading.box.x,
                         reading.box.y, reading.box.width, reading.box.height,
                         watched_text(match)));
}

void print_event(const plate::PlateEvent& event, const std::optional<plate::WatchMatch>& match) {
  print_text(fmt::format("{:.1f}-{:.1f} s: {} {:.2f}{}{} ({} {}){}\n", event.first_time,
                         event.last_time, event.text, event.confidence,
                         event.country.empty() ? "" : " ", event.country, event.frames,
                         event.frames == 1 ? "frame" : "frames", watched_text(match)));
}

// When a file was last written; nothing where there is none.
std::optional<plate::Moment> modified(const std::string& path) {
  struct ::stat info {};
  if (::stat(path.c_str(), &info) != 0) return std::nullopt;
  return plate::Moment(std::chrono::duration_cast<std::chrono::milliseconds>(
      std::chrono::seconds(info.st_mtim.tv_sec) + std::chrono::nanoseconds(info.st_mtim.tv_nsec)));
}

std::chrono::milliseconds length_of(const FrameSource& source) {
  if (source.count() <= 0 || source.fps() <= 0) return std::chrono::milliseconds(0);
  return std::chrono::milliseconds(
      std::llround(1000 * static_cast<double>(source.count()) / source.fps()));
}

// How the frames of a source lie in time, by its name in Frame::name.
plate::SourceTimes times_of(const std::string& name, const ReadFlags& flags) {
  const plate::Moment now = plate::moment_now();
  std::optional<plate::Moment> start;
  if (!flags.start.empty()) start = plate::parse_moment(flags.start, now, false, "--start");
  constexpr std::string_view kDrawn = "synth:";
  if (name.starts_with(kDrawn)) {
    const auto drawn = synth::open_synth_source(name.substr(kDrawn.size()), flags.run.source);
    if (drawn->is_live()) return {};
    // As if its recording had ended just now: not in the future, however fast it is read.
    if (!start) start = plate::recording_start(now, length_of(*drawn), now);
    return {false, start};
  }
  try {
    switch (classify_source(name)) {
      case SourceKind::kVideo: {
        if (start) return {false, start};
        const auto written = modified(name);
        const auto length = length_of(*open_source(name));
        if (written && length.count() > 0) start = plate::recording_start(*written, length, now);
        return {false, start};
      }
      case SourceKind::kFolder:  // images in sequence
        return {false, start};
      default:
        return {};
    }
  } catch (const InputError&) {  // of a kind of its own
    return {};
  }
}

// Wall clock, log and command: all that is done with what the session says of vehicles.
class Reports {
 public:
  Reports(const ReadFlags& flags, Context& context)
      : flags_(flags),
        context_(context),
        clock_(plate::system_clocks()),
        on_event_(flags.on_event, context),
        publisher_(make_publisher(flags.publish)) {
    if (!flags.start.empty()) {
      (void)plate::parse_moment(flags.start, plate::moment_now(), false, "--start");
      if (flags.run.inputs.size() > 1) throw UsageError("--start goes with one input");
    }
    if (!flags.watch.empty()) watch_.emplace(flags.watch);
    if (flags.log.empty()) return;
    log_.emplace(flags.log);
    past_.emplace(flags.log, DatabaseAccess::kRead);
    if (!plate::is_plausible(plate::moment_now())) {
      log_warning("the clock says {}: entries of {} are corrected when it is set",
                  plate::moment_text(plate::moment_now()), flags.log);
    }
  }

  void set_session(PlateSession& session) { session_ = &session; }

  plate::FrameMoment moment_of(const Frame& frame) {
    const std::string source = source_of(frame);
    if (source != source_) clock_.begin(times_of(source, flags_), frame.time);
    source_ = source;
    const plate::FrameMoment seen = clock_.at(frame.time, frame.captured);
    if (const auto step = clock_.take_step()) {
      log_warning("the clock was set by {:.0f} s", static_cast<double>(step->count()) / 1000);
      if (session_ != nullptr) session_->shift_unsynchronized(*step);
      if (log_) log_->shift_unsynchronized(*step);
    }
    if (seen.synchronized && !was_synchronized_ && log_) log_->trust_clock();
    was_synchronized_ = seen.synchronized;
    return seen;
  }

  void vehicle(const plate::PlateEvent& event) {
    if (log_) log_->record(event);
    const auto match = match_of(event);
    // What is learnt of a vehicle while it is in sight is said where it begins to match.
    const bool is_new_match = match && !watched_.contains(event.id);
    if (event.state == plate::PlateState::kUpdated && !is_new_match) return;
    if (match) watched_.insert(event.id);
    const bool is_watched = watched_.contains(event.id);
    const bool is_closed = event.state == plate::PlateState::kClosed;
    const bool is_over = is_closed || event.state == plate::PlateState::kWithdrawn;
    if (is_over) watched_.erase(event.id);
    const bool is_wanted = on_event_ && (is_watched || !flags_.on_watch);
    if (!is_wanted && !is_closed && !publisher_) return;
    const nlohmann::ordered_json line = line_of(event, match);
    if (is_wanted) on_event_.post(line);
    if (publisher_) publisher_->post(json_text(line));
    if (!is_closed) return;
    found_ = true;
    if (context_.json)
      print_json(line);
    else
      print_event(event, match);
  }

  // A still has no vehicle that comes and goes: what is read in it is an event as it is.
  void still(const Frame& frame, const std::vector<plate::Reading>& readings) {
    const plate::Moment now = plate::moment_now();
    for (const plate::Reading& reading : readings) {
      if (reading.text.empty() || (!log_ && !on_event_ && !watch_ && !publisher_)) {
        if (!context_.json) print_reading(frame, reading, std::nullopt);
        continue;
      }
      plate::PlateEvent event = plate::event_of(reading, frame.image);
      event.id = -++stills_;  // none of the vehicles
      event.source = frame.name;
      event.first_seen = event.last_seen = std::min(modified(frame.name).value_or(now), now);
      const auto match = match_of(event);
      if (!context_.json) print_reading(frame, reading, match);
      if (on_event_ && (match || !flags_.on_watch)) on_event_.post(line_of(event, match));
      if (publisher_) publisher_->post(json_text(line_of(event, match)));
      if (log_) log_->record(event);
    }
  }

  void check() {
    if (log_) log_->check();
  }

  // What is on its way is written, or said to be lost.
  void finish(bool interrupted) {
    if (log_) log_->finish(interrupted ? kInterruptedPatience_s : kPatience_s);
    on_event_.finish();
    if (publisher_)
      publisher_->finish(interrupted ? kInterruptedPublish_s : flags_.publish.options.finish_s);
  }

  [[nodiscard]] bool found() const { return found_; }

 private:
  std::optional<plate::WatchMatch> match_of(const plate::PlateEvent& event) {
    if (!watch_ || event.state == plate::PlateState::kWithdrawn) return std::nullopt;
    return watch_->current().find(event, plate::local_time(event.last_seen));
  }

  // The event, with what the list and the log say of it.
  nlohmann::ordered_json line_of(const plate::PlateEvent& event,
                                 const std::optional<plate::WatchMatch>& match) {
    nlohmann::ordered_json line = event_json(event);
    if (watch_) line["watch"] = match ? watch_json(*match) : nlohmann::ordered_json();
    if (past_) {
      try {
        line["history"] = history_json(past_->history(event.text, event.first_seen), event);
      } catch (const DatabaseLockedError&) {
        line["history"] = nullptr;
      }
    }
    return line;
  }

  static constexpr double kPatience_s = 70;  // more than a lock is waited for
  static constexpr double kInterruptedPatience_s = 5;
  static constexpr double kInterruptedPublish_s = 1;

  const ReadFlags& flags_;
  Context& context_;
  plate::SourceClock clock_;
  OnEvent on_event_;
  std::unique_ptr<mqtt::Publisher> publisher_;
  std::optional<plate::PlateRecorder> log_;
  std::optional<plate::PlateLog> past_;  // the same file
  std::optional<plate::WatchFile> watch_;
  std::set<std::int64_t> watched_;  // vehicles in sight that the list knows
  PlateSession* session_ = nullptr;
  std::string source_;
  bool was_synchronized_ = true;
  bool found_ = false;
  std::int64_t stills_ = 0;
};

ExitStatus run_read(ReadFlags& flags, Context& context) {
  if (!flags.region.empty()) flags.tracker.region = plate::parse_region(flags.region);
  flags.tracker.check();
  // Without an image wanted, the readings are the output.
  default_to_headless(flags.run);
  plate::VideoReader reader = plate::VideoReader::load(
      ModelStore::find(), {reader_options(flags.plate, context), flags.tracker});
  Reports reports(flags, context);
  DebugFolder debug(context.debug_dir);
  bool found = false;
  PlateSession session(
      std::move(reader), [&](const plate::PlateEvent& event) { reports.vehicle(event); },
      [&](const Frame& frame) { return reports.moment_of(frame); }, debug.sink());
  reports.set_session(session);

  RunHooks hooks;
  hooks.title = "plates";
  hooks.debug = &debug;
  hooks.after_frame = [&](const Frame& frame) {
    found = found || ((frame.still || !flags.events_only) && !session.readings().empty());
    if (frame.still) reports.still(frame, session.readings());
    reports.check();
  };
  hooks.describe = [&](const View&, nlohmann::ordered_json& line) {
    line.update(to_json(session.result()));
  };
  hooks.quiet_frames = flags.events_only;
  ExitStatus status = ExitStatus::kDone;
  try {
    status = run_session(session, flags.run, context, hooks);
  } catch (...) {
    session.finish();  // what was seen before the source broke
    reports.finish(true);
    throw;
  }
  session.finish();
  reports.finish(status == ExitStatus::kInterrupted);
  return status == ExitStatus::kDone && !found && !reports.found() ? ExitStatus::kNothingFound
                                                                   : status;
}

void add_flags(Command& verb, ReadFlags& flags) {
  add_run_flags(verb, flags.run);
  add_plate_flags(verb, flags.plate);
  const auto video = [](Flag& flag) { flag.group("Videos and cameras"); };
  video(verb.add_option("--roi", flags.region,
                        "only plates whose centre is in x,y,w,h or a polygon 'x,y x,y x,y'; px, or "
                        "shares of the image where no number is above 1"));
  video(verb.add_flag("--events", flags.events_only, "JSON: only events, no line for each frame"));
  bind_all(verb, flags.tracker, "Videos and cameras");
  video(verb.add_option("--log", flags.log, "SQLite file that every vehicle is written to"));
  video(
      verb.add_option("--start", flags.start,
                      "when a video file begins: 2024-05-01T12:30 (UTC) [when it was last written, "
                      "less its length]"));
  Flag& watch = verb.add_option("--watch", flags.watch,
                                "list of plates that matter (`plate watch`): events say which "
                                "entry matches; read again when it changes");
  watch.group("Events");
  Flag& command =
      add_on_event_flags(verb, flags.on_event, "when a vehicle is opened, closed or withdrawn");
  verb.add_flag("--on-watch", flags.on_watch, "--on-event only for vehicles of the --watch list")
      .needs(watch)
      .needs(command)
      .group("Events");
  add_publish_flags(verb, flags.publish);
}

}  // namespace

void add_plate_read(Command& plate, Context& context) {
  add_debug_flag(
      add_verb<ReadFlags>(plate, "read", "reads the plates of images, videos and cameras", context,
                          add_flags, run_read),
      context);
}

}  // namespace tarsier::cli
