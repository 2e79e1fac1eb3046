// SPDX-License-Identifier: MIT
#include "verbs/plate/reports.h"

#include "tarsier/core/log.h"
#include "tarsier/media/still_source.h"
#include "tarsier/synth/sources.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string_view>
#include <sys/stat.h>
#include <utility>

namespace tarsier::cli {
namespace {

constexpr double kFinishTimeout_s = 70;  // longer than the wait for a lock
constexpr double kInterruptedTimeout_s = 5;

std::string watched_text(const std::optional<plate::WatchMatch>& match) {
  if (!match) return {};
  const std::string& label = match->entry->label;
  return fmt::format(" watched: {}{}{}", match->entry->plate, label.empty() ? "" : " ",
                     printable(label));
}

void print_reading(const Frame& frame, const plate::Reading& reading,
                   const std::optional<plate::WatchMatch>& match) {
  print_text(fmt::format("{}: {} {:.2f}{}{} [{},{} {}x{}]{}\n", printable(frame.name),
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

// When a file was last written; nullopt if it does not exist.
std::optional<plate::Moment> modification_time(const std::string& path) {
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

// The time of a source's frames, by its name in Frame::name.
plate::SourceTimes source_times(const std::string& name, const ReportFlags& flags,
                                const SourceOptions& options) {
  const plate::Moment now = plate::moment_now();
  std::optional<plate::Moment> start;
  if (!flags.start.empty()) start = plate::parse_moment(flags.start, now, false, "--start");
  constexpr std::string_view kSynthPrefix = "synth:";
  if (name.starts_with(kSynthPrefix)) {
    const auto synth_source = synth::open_synth_source(name.substr(kSynthPrefix.size()), options);
    if (synth_source->is_live()) return {};
    // As if its recording had just ended: no time is in the future, however fast it is read.
    if (!start) start = plate::recording_start(now, length_of(*synth_source), now);
    return {false, start};
  }
  try {
    switch (classify_source(name)) {
      case SourceKind::kVideo: {
        if (start) return {false, start};
        const auto written = modification_time(name);
        const auto length = length_of(*open_source(name));
        if (written && length.count() > 0) start = plate::recording_start(*written, length, now);
        return {false, start};
      }
      case SourceKind::kFolder:  // images with --sequence
        return {false, start};
      default:
        return {};
    }
  } catch (const InputError&) {  // a scheme of its own
    return {};
  }
}

}  // namespace

void UnsuitablePlateCounter::add(const std::vector<plate::Reading>& readings) {
  for (const plate::Reading& reading : readings) {
    ++plates_;
    if (reading.unfit.empty()) continue;
    ++unfit_;
    if (example_.empty()) example_ = reading.unfit;
  }
}

void UnsuitablePlateCounter::warn(const std::vector<std::string>& countries) const {
  if (unfit_ == 0) return;
  log_warning(
      "{} of {} readings fit no layout of --country {} (one looks like {}): their confidence is "
      "low; name their country as well, or leave --country out",
      unfit_, plates_, fmt::join(countries, ","), printable(example_));
}

void add_report_flags(Command& verb, ReportFlags& flags) {
  const auto video = [](Flag& flag) { flag.group("Videos and cameras"); };
  video(verb.add_option("--log", flags.log, "SQLite log of all vehicles"));
  video(verb.add_option(
      "--start", flags.start,
      "start time of a video file: 2024-05-01T12:30 (UTC) [file time minus duration]"));
  Flag& watch = verb.add_option(
      "--watch", flags.watch,
      "watch list (`plate watch`): events name the matching entry; reloaded on change");
  watch.group("Events");
  Flag& command =
      add_on_event_flags(verb, flags.on_event, "when a vehicle is opened, closed or withdrawn");
  verb.add_flag("--on-watch", flags.on_watch,
                "run --on-event only for vehicles on the --watch list")
      .needs(watch)
      .needs(command)
      .group("Events");
  add_publish_flags(verb, flags.publish);
}

PlateReports::PlateReports(const ReportFlags& flags, const RunFlags& run, const Context& context)
    : flags_(flags),
      run_(run),
      context_(context),
      clock_(plate::system_clocks()),
      on_event_(flags.on_event, context),
      publisher_(flags.publish, http_access(run)) {
  if (!flags.start.empty()) {
    (void)plate::parse_moment(flags.start, plate::moment_now(), false, "--start");
    if (run.inputs.size() > 1) throw UsageError("--start needs a single input");
  }
  if (!flags.watch.empty()) watch_.emplace(flags.watch);
  if (flags.log.empty()) return;
  log_.emplace(flags.log);
  log_reader_.emplace(flags.log, DatabaseAccess::kRead);
  if (!plate::is_plausible(plate::moment_now())) {
    log_warning("the clock says {}: entries of {} are corrected when it is set",
                plate::moment_text(plate::moment_now()), flags.log);
  }
}

plate::FrameMoment PlateReports::moment_of(const Frame& frame) {
  const std::string source = source_of(frame);
  if (source != source_) clock_.begin(source_times(source, flags_, run_.source), frame.time);
  source_ = source;
  std::chrono::milliseconds step{0};
  const plate::FrameMoment seen = tick(frame, step);
  if (step.count() != 0 && on_step_) on_step_(step);
  return seen;
}

plate::SiteMoment PlateReports::site_moment_of(const Frame& frame) {
  if (source_.empty()) clock_.begin({}, frame.time);  // all are live: they share one clock
  source_ = frame.name;
  plate::SiteMoment moment;
  moment.frame_moment = tick(frame, moment.step);
  return moment;
}

plate::FrameMoment PlateReports::tick(const Frame& frame, std::chrono::milliseconds& step) {
  const plate::FrameMoment seen = clock_.at(frame.time, frame.captured);
  if (const auto set = clock_.take_step()) {
    log_warning("the clock was set by {:.0f} s", static_cast<double>(set->count()) / 1000);
    if (log_) log_->shift_unsynchronized(*set);
    step = *set;
  }
  if (seen.synchronized && !was_synchronized_ && log_) log_->trust_clock();
  was_synchronized_ = seen.synchronized;
  return seen;
}

void PlateReports::report_vehicle(const plate::PlateEvent& event) {
  if (log_) log_->record(event);
  const auto match = match_of(event);
  // Updates of a vehicle are reported only when it starts to match.
  const bool is_new_match = match && !watched_.contains(event.id);
  if (event.state == plate::PlateState::kUpdated && !is_new_match) return;
  if (match) watched_.insert(event.id);
  const bool is_watched = watched_.contains(event.id);
  const bool is_closed = event.state == plate::PlateState::kClosed;
  const bool is_over = is_closed || event.state == plate::PlateState::kWithdrawn;
  if (is_over) watched_.erase(event.id);
  const bool posts_event = on_event_ && (is_watched || !flags_.on_watch);
  if (!posts_event && !is_closed && !publisher_) return;
  const nlohmann::ordered_json line = line_of(event, match);
  if (posts_event) on_event_.post(line);
  publisher_.post(line, event.best_crop);
  if (!is_closed) return;
  has_closed_events_ = true;
  if (context_.json)
    print_json(line);
  else
    print_event(event, match);
}

void PlateReports::report_still(const Frame& frame, const std::vector<plate::Reading>& readings) {
  const plate::Moment now = plate::moment_now();
  if (readings.empty() && !context_.json && !context_.quiet)
    print_text(fmt::format("{}: no plate\n", printable(frame.name)));
  for (const plate::Reading& reading : readings) {
    if (reading.text.empty() || (!log_ && !on_event_ && !watch_ && !publisher_)) {
      if (!context_.json) print_reading(frame, reading, std::nullopt);
      continue;
    }
    plate::PlateEvent event = plate::event_of(reading, frame.image);
    event.id = -++stills_;  // not a vehicle's id
    event.source = frame.name;
    event.first_seen = event.last_seen = std::min(modification_time(frame.name).value_or(now), now);
    const auto match = match_of(event);
    if (!context_.json) print_reading(frame, reading, match);
    const bool posts_event = on_event_ && (match || !flags_.on_watch);
    nlohmann::ordered_json line;
    if (posts_event || publisher_) line = line_of(event, match);  // before its own entry
    if (log_) log_->record(event);
    if (posts_event) on_event_.post(line);
    publisher_.post(std::move(line), event.best_crop);
  }
}

void PlateReports::check() {
  if (log_) log_->check();
}

void PlateReports::finish(bool interrupted) {
  if (log_) log_->finish(interrupted ? kInterruptedTimeout_s : kFinishTimeout_s);
  on_event_.finish();
  publisher_.finish(interrupted);
}

std::optional<plate::WatchMatch> PlateReports::match_of(const plate::PlateEvent& event) {
  if (!watch_ || event.state == plate::PlateState::kWithdrawn) return std::nullopt;
  return watch_->current().find(event, plate::local_time(event.last_seen));
}

nlohmann::ordered_json PlateReports::line_of(const plate::PlateEvent& event,
                                             const std::optional<plate::WatchMatch>& match) {
  nlohmann::ordered_json line = event_json(event);
  if (watch_) line["watch"] = match ? watch_json(*match) : nlohmann::ordered_json();
  if (log_reader_) {
    try {
      line["history"] = history_json(log_reader_->history(event.text, event.first_seen), event);
    } catch (const DatabaseLockedError&) {
      line["history"] = nullptr;
    }
  }
  return line;
}

}  // namespace tarsier::cli
