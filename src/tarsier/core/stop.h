// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <stop_token>

namespace tarsier {

// The token of SIGINT and SIGTERM. The first call blocks both signals in the calling thread and
// starts a thread that waits for them, so call it from main before any other thread starts; later
// calls return the same token. A second signal ends the process at once with status 130.
[[nodiscard]] std::stop_token stop_on_signals();

// While one lives, the first signal, too, ends the process at once with status 130: for work that
// writes nothing and has no token to look at.
class EndOnSignals {
 public:
  EndOnSignals();
  ~EndOnSignals();
  EndOnSignals(const EndOnSignals&) = delete;
  EndOnSignals& operator=(const EndOnSignals&) = delete;
};

// Throws Interrupted if `stop` has fired.
void throw_if_stopped(const std::stop_token& stop);

// Sleeps for `duration` or until `stop` fires; returns false if it fired.
bool sleep_unless_stopped(std::chrono::milliseconds duration, const std::stop_token& stop);

}  // namespace tarsier
