// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame.h"
#include "tarsier/plate/site/site.h"
#include "tarsier/plate/tracking/log.h"
#include "tarsier/plate/tracking/recorder.h"
#include "tarsier/plate/tracking/source_clock.h"
#include "tarsier/plate/tracking/watch.h"

#include "framework/cli.h"
#include "framework/on_event.h"
#include "framework/publish.h"
#include "framework/run_session.h"
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace tarsier::cli {

// The flags that say where `plate read` reports vehicles.
struct ReportFlags {
  std::string log;
  std::string start;
  OnEventFlags on_event;
  std::string watch;
  bool on_watch = false;
  PublishFlags publish;
};

// Counts plates of countries that were not requested.
class UnsuitablePlateCounter {
 public:
  void add(const std::vector<plate::Reading>& readings);
  void warn(const std::vector<std::string>& countries) const;

 private:
  std::int64_t plates_ = 0;
  std::int64_t unfit_ = 0;
  std::string example_;
};

void add_report_flags(Command& verb, ReportFlags& flags);

// Reports events to the log, watch list, command and broker, with wall-clock times. Not
// thread-safe.
class PlateReports {
 public:
  // `flags`, `run` and `context` must outlive this object. Throws the errors of the named outputs.
  PlateReports(const ReportFlags& flags, const RunFlags& run, const Context& context);

  // `call` gets the step when the wall clock was set.
  void on_step(std::function<void(std::chrono::milliseconds)> call) { on_step_ = std::move(call); }

  // The moment of a frame of a single video or camera.
  plate::FrameMoment moment_of(const Frame& frame);
  // The moment of a frame of one of several cameras.
  plate::SiteMoment site_moment_of(const Frame& frame);

  void report_vehicle(const plate::PlateEvent& event);
  // In a still no vehicle appears or leaves: each reading is an event.
  void report_still(const Frame& frame, const std::vector<plate::Reading>& readings);

  // Throws an error of the log that occurred since the last call.
  void check();
  // Writes pending events, or reports them as lost.
  void finish(bool interrupted);

  [[nodiscard]] bool has_closed_events() const { return has_closed_events_; }

 private:
  plate::FrameMoment tick(const Frame& frame, std::chrono::milliseconds& step);
  [[nodiscard]] std::optional<plate::WatchMatch> match_of(const plate::PlateEvent& event);
  // The JSON line of an event, with data of the watch list and the log.
  [[nodiscard]] nlohmann::ordered_json line_of(const plate::PlateEvent& event,
                                               const std::optional<plate::WatchMatch>& match);

  const ReportFlags& flags_;
  const RunFlags& run_;
  const Context& context_;
  plate::SourceClock clock_;
  OnEvent on_event_;
  EventPublisher publisher_;
  std::optional<plate::PlateRecorder> log_;
  std::optional<plate::PlateLog> log_reader_;  // reads the same file
  std::optional<plate::WatchFile> watch_;
  std::set<std::int64_t> watched_;  // visible vehicles that are on the watch list
  std::function<void(std::chrono::milliseconds)> on_step_;
  std::string source_;
  bool was_synchronized_ = true;
  bool has_closed_events_ = false;
  std::int64_t stills_ = 0;
};

}  // namespace tarsier::cli
