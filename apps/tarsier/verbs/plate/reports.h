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
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace tarsier::cli {

// What is done with the vehicles that `plate read` sees.
struct ReportFlags {
  std::string log;
  std::string start;
  OnEventFlags on_event;
  std::string watch;
  bool on_watch = false;
  PublishFlags publish;
};

void add_report_flags(Command& verb, ReportFlags& flags);

// Wall clock, log, watch list, command and broker. One caller at a time.
class PlateReports {
 public:
  // `flags`, `run` and `context` must live longer. Throws as what the flags name does.
  PlateReports(const ReportFlags& flags, const RunFlags& run, const Context& context);

  // Called when the wall clock was set by so much.
  void on_step(std::function<void(std::chrono::milliseconds)> call) { on_step_ = std::move(call); }

  // Of a frame of a video or camera, of which one follows the other.
  plate::FrameMoment moment_of(const Frame& frame);
  // Of a frame of one of several cameras.
  plate::SiteMoment site_moment_of(const Frame& frame);

  void vehicle(const plate::PlateEvent& event);
  // A still has no vehicle that comes and goes: what is read in it is an event as it is.
  void still(const Frame& frame, const std::vector<plate::Reading>& readings);

  // Throws what went wrong with the log since.
  void check();
  // What is on its way is written, or said to be lost.
  void finish(bool interrupted);

  [[nodiscard]] bool found() const { return found_; }

 private:
  plate::FrameMoment tick(const Frame& frame, std::chrono::milliseconds& step);
  [[nodiscard]] std::optional<plate::WatchMatch> match_of(const plate::PlateEvent& event);
  // The event, with what the list and the log say of it.
  [[nodiscard]] nlohmann::ordered_json line_of(const plate::PlateEvent& event,
                                               const std::optional<plate::WatchMatch>& match);

  const ReportFlags& flags_;
  const RunFlags& run_;
  const Context& context_;
  plate::SourceClock clock_;
  OnEvent on_event_;
  EventPublisher publisher_;
  std::optional<plate::PlateRecorder> log_;
  std::optional<plate::PlateLog> past_;  // the same file
  std::optional<plate::WatchFile> watch_;
  std::set<std::int64_t> watched_;  // vehicles in sight that the list knows
  std::function<void(std::chrono::milliseconds)> on_step_;
  std::string source_;
  bool was_synchronized_ = true;
  bool found_ = false;
  std::int64_t stills_ = 0;
};

}  // namespace tarsier::cli
