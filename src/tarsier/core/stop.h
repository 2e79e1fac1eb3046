// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <stop_token>

namespace tarsier {

// The token that SIGINT and SIGTERM trigger. The first call blocks both signals in the calling
// thread and starts a thread that waits for them: call it from main before any other thread starts.
// Later calls return the same token. A second signal ends the process at once with status 130.
[[nodiscard]] std::stop_token stop_on_signals();

// While an object of this class lives, the first signal also ends the process at once with status
// 130. For work that writes nothing and checks no token.
class EndOnSignals {
 public:
  EndOnSignals();
  ~EndOnSignals();
  EndOnSignals(const EndOnSignals&) = delete;
  EndOnSignals& operator=(const EndOnSignals&) = delete;
};

// Maximum duration of one wait before the stop token is checked again.
inline constexpr std::chrono::milliseconds kStopCheckInterval{50};

// Throws Interrupted if `stop` was triggered.
void throw_if_stopped(const std::stop_token& stop);

// Sleeps for `duration` or until `stop` is triggered; returns false if it was triggered.
bool sleep_unless_stopped(std::chrono::milliseconds duration, const std::stop_token& stop);

}  // namespace tarsier
