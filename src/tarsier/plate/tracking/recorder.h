// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/plate/tracking/event.h"

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace tarsier::plate {

struct RecorderOptions {
  // s that a log which another program has locked is waited for, while reading goes on
  double max_lock = 60;
  // s that record() waits for the disk where nothing is locked
  double max_wait = 3;
  std::size_t max_waiting = 2000;  // vehicles that wait to be written
  int attempt_ms = 100;            // how long one attempt waits for a lock

  [[nodiscard]] OptionFields fields() {
    return {{"max_lock", max_lock, range(0, 3600)},
            {"max_wait", max_wait, range(0, 60)},
            {"max_waiting", max_waiting, range(1, 100'000)},
            {"attempt_ms", attempt_ms, range(1, 5000)}};
  }
  void check() const { check_fields(*this); }
};

// This process, by a name that no other one has or will have: the system's start, the space of
// process numbers, the number, and when it started.
[[nodiscard]] std::string process_name();
// Whether a process of such a name still runs on this machine.
[[nodiscard]] bool is_running(const std::string& process_name);

// Keeps a log up to date with what a tracker says of vehicles. Each is an entry from when it is
// opened; it is updated, closed or taken out later. A thread writes. record() returns when what it
// was given is on the disk; but while another program holds the log, or the disk is slow, it
// returns at once and what waits is written when that is over. So frames go on being read, and what
// is lost when the machine stops is what nobody was sure of yet.
//
//   PlateRecorder recorder("plates.db");
//   for each frame:
//     for (const PlateEvent& event : take_news(options, state)) recorder.record(event);
//     for (const PlateEvent& event : closed) recorder.record(event);
//   recorder.finish();
//
// Not thread-safe: one caller.
class PlateRecorder {
 public:
  // Entries that programs which died have left open become interrupted ones. Throws as
  // media/sqlite.h says.
  explicit PlateRecorder(const std::string& path, const RecorderOptions& options = {});
  // What can be written without waiting for a lock is.
  ~PlateRecorder();
  PlateRecorder(const PlateRecorder&) = delete;
  PlateRecorder& operator=(const PlateRecorder&) = delete;

  // Throws the error of an earlier attempt to write: of a lock only after `max_lock`. Waits for
  // room where `max_waiting` vehicles wait.
  void record(const PlateEvent& event);

  // The wall clock was set by so much: entries of this run from before, while it was not
  // synchronized, are corrected. Throws as record().
  void shift_unsynchronized(std::chrono::milliseconds by);
  // The clock is synchronized: the entries of this run are right.
  void trust_clock();

  // Throws what went wrong since; to be called now and then while there is nothing to record.
  void check();

  // Waits until all is written, or until the lock has lasted for `max_lock`; at most `patience_s`.
  // Throws OutputError saying how many vehicles are not in the log.
  void finish(double patience_s = 3600);

  [[nodiscard]] std::size_t waiting() const;  // vehicles that are not on the disk yet

 private:
  class Writer;
  std::unique_ptr<Writer> writer_;
};

}  // namespace tarsier::plate
