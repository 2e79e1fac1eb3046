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
  // s to wait while another program locks the log; reading continues meanwhile.
  double max_lock = 60;
  // s for which record() waits for the disk while nothing is locked.
  double max_wait = 3;
  std::size_t max_waiting = 2000;  // vehicles that wait to be written
  int attempt_ms = 100;            // ms for which one attempt waits for a lock

  [[nodiscard]] OptionFields fields() {
    return {{"max_lock", max_lock, range(0, 3600)},
            {"max_wait", max_wait, range(0, 60)},
            {"max_waiting", max_waiting, range(1, 100'000)},
            {"attempt_ms", attempt_ms, range(1, 5000)}};
  }
  void check() const { check_fields(*this); }
};

// A unique name of this process. No other process has it or will have it: boot id, PID namespace,
// process number and start time.
[[nodiscard]] std::string process_name();
// Returns whether the process of this name still runs on this machine.
[[nodiscard]] bool is_running(const std::string& process_name);

// Keeps a log up to date with the events of a tracker. A vehicle has an entry from its kOpened
// event on; later events update, close or remove it. A thread writes the entries.
//
// record() returns when its event is on the disk. If another program holds the log or the disk is
// slow, record() returns at once and the event is written later. Frames therefore continue to be
// read. If the machine stops, only vehicles that were not yet confirmed are lost.
//
//   PlateRecorder recorder("plates.db");
//   for each frame:
//     for (const PlateEvent& event : take_updates(options, state)) recorder.record(event);
//     for (const PlateEvent& event : closed) recorder.record(event);
//   recorder.finish();
//
// Not thread-safe.
class PlateRecorder {
 public:
  // Open entries of programs that have died become interrupted. Errors are those of media/sqlite.h.
  explicit PlateRecorder(const std::string& path, const RecorderOptions& options = {});
  // Writes everything that can be written without waiting for a lock.
  ~PlateRecorder();
  PlateRecorder(const PlateRecorder&) = delete;
  PlateRecorder& operator=(const PlateRecorder&) = delete;

  // Throws the error of an earlier attempt to write; a lock is an error only after `max_lock`.
  // Waits if `max_waiting` vehicles already wait.
  void record(const PlateEvent& event);

  // The wall clock was set by `by`: corrects the entries of this run that were written while it was
  // not synchronized. Throws the same exceptions as record().
  void shift_unsynchronized(std::chrono::milliseconds by);
  // The clock is synchronized, so the entries of this run are right.
  void trust_clock();

  // Throws the error of an earlier attempt to write. Call it periodically while there is nothing to
  // record.
  void check();

  // Waits until everything is written, until a lock has lasted for `max_lock`, or for `timeout_s`.
  // Throws OutputError, which says how many vehicles are not in the log.
  void finish(double timeout_s = 3600);

 private:
  class Writer;
  std::unique_ptr<Writer> writer_;
};

}  // namespace tarsier::plate
