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
  double timeout_s = 10;          // s, of one run of the command
  std::size_t max_waiting = 100;  // events; beyond that the oldest are dropped
  // s. finish() gives all waiting events together this time; after an interruption `interrupted_s`.
  double finish_s = 10;
  double interrupted_s = 1;
  std::string name = "event command";  // name in warnings

  [[nodiscard]] OptionFields fields() {
    return {{"timeout_s", timeout_s, range(0.01, 3600), "--on-event-timeout",
             "s until the program is killed; also the total limit at the end of the run"},
            {"max_waiting", max_waiting, range(1, 100'000)},
            {"finish_s", finish_s, range(0, 3600)},
            {"interrupted_s", interrupted_s, range(0, 60)}};
  }
  void check() const { check_fields(*this); }
};

// Runs a command for each event, one after the other, in parallel with the program. /bin/sh runs
// the command in a process group of its own. Its stdin is the event and a line break, its output
// goes to our stderr, and it inherits no other file. No part of an event enters the command line,
// so no name can inject shell code. A run that exceeds the timeout is killed with all processes of
// its group. post() never waits. Failures are reported as warnings.
class EventCommand {
 public:
  struct Counts {
    std::int64_t ended = 0;    // ended by themselves with status 0
    std::int64_t failed = 0;   // ended with another status, or not started
    std::int64_t killed = 0;   // killed at the timeout or at the end
    std::int64_t dropped = 0;  // events for which no command was run
  };

  // When `stop` is triggered, waiting events get `interrupted_s`. Throws std::invalid_argument for
  // an empty command or invalid options.
  EventCommand(std::string command, const EventCommandOptions& options, std::stop_token stop = {});
  ~EventCommand();  // calls finish()
  EventCommand(const EventCommand&) = delete;
  EventCommand& operator=(const EventCommand&) = delete;

  // Adds an event: one line, without its line break. Thread-safe.
  void post(std::string event);

  // Accepts no more events. Waits for the waiting ones for `finish_s` (after an interruption
  // `interrupted_s`) plus the time that a kill takes. Then kills the running command and drops the
  // rest with a warning.
  void finish();

  [[nodiscard]] Counts counts() const;

 private:
  class Runner;
  std::unique_ptr<Runner> runner_;
};

}  // namespace tarsier
