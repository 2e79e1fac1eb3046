// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <stop_token>
#include <string>

namespace tarsier {

struct EventCommandOptions {
  double timeout_s = 10;          // of one run of the command
  std::size_t max_waiting = 100;  // events; where more come, the oldest are dropped
  // finish() gives the events that wait so long in all; after an interruption, `interrupted_s`.
  double finish_s = 10;
  double interrupted_s = 1;
  std::string name = "event command";  // how warnings call it

  [[nodiscard]] OptionFields fields() {
    return {{"timeout_s", timeout_s, range(0.01, 3600), "--on-event-timeout",
             "s until the program is killed; also the total limit at the end of the run"},
            {"max_waiting", max_waiting, range(1, 100'000)},
            {"finish_s", finish_s, range(0, 3600)},
            {"interrupted_s", interrupted_s, range(0, 60)}};
  }
  void check() const { check_fields(*this); }
};

// Runs a command for each event, one after the other, beside what else the program does. The
// command is run by /bin/sh, with the event and a line break on its stdin, its output on our
// stderr, in a process group of its own, without any other file of ours. Nothing of an event is
// part of the command, so no name can break out of it. A run that takes longer than the timeout is
// killed with all that it started (but what left its group). post() never waits. Failures are
// warned of.
class EventCommand {
 public:
  struct Counts {
    std::int64_t ended = 0;    // by themselves, with status 0 ..
    std::int64_t failed = 0;   // .. or another one, or not started
    std::int64_t killed = 0;   // at the timeout, or at the end
    std::int64_t dropped = 0;  // events that no command was run for
  };

  // When `stop` fires, what waits gets `interrupted_s`. Throws std::invalid_argument for an empty
  // command or bad options.
  EventCommand(std::string command, const EventCommandOptions& options, std::stop_token stop = {});
  ~EventCommand();  // as finish()
  EventCommand(const EventCommand&) = delete;
  EventCommand& operator=(const EventCommand&) = delete;

  // An event: one line, without its line break. Thread-safe.
  void post(std::string event);

  // No more events: waits for those that are there, `finish_s` (after an interruption
  // `interrupted_s`) and the moment that killing takes; then the running command is killed and the
  // rest dropped with a warning.
  void finish();

  [[nodiscard]] Counts counts() const;

 private:
  class Runner;
  std::unique_ptr<Runner> runner_;
};

}  // namespace tarsier
