// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"
#include "ui/session.h"
#include <chrono>
#include <functional>
#include <optional>
#include <string>

namespace tarsier::cli {

// Called between events. It may give the session a frame or time to work, and returns the session's
// view. `wait` is the maximum time until the next call.
using BetweenEvents = std::function<std::optional<View>(std::chrono::milliseconds& wait)>;

// Runs a session in a window until the user ends it, independent of its frames. The first view is
// that of on_idle(). With --json each key, button and action prints a line {"event","state"}.
// Returns kInterrupted after a signal, else kDone. window::prepare() must have been called.
[[nodiscard]] ExitStatus browse_session(Session& session, const std::string& title, bool fullscreen,
                                        Context& context, const BetweenEvents& between);

// Prints {"event","state"} to stdout.
void print_event_line(const Event& event, const View& view);

}  // namespace tarsier::cli
