// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"
#include "ui/session.h"
#include <chrono>
#include <functional>
#include <optional>
#include <string>

namespace tarsier::cli {

// Called between events: may give the session something (a frame, time to work) and return its
// view; `wait` is how long it may then take until the next call.
using Between = std::function<std::optional<View>(std::chrono::milliseconds& wait)>;

// A session in a window that lasts until the user ends it, whatever its frames do; it shows what
// on_idle() gives at first. With --json each key, button and action gives a line {"event","state"}.
// Returns kInterrupted where a signal came, else kDone. window::prepare() must have been called.
[[nodiscard]] ExitStatus browse_session(Session& session, const std::string& title, bool fullscreen,
                                        Context& context, const Between& between);

// {"event","state"} on stdout.
void print_event_line(const Event& event, const View& view);

}  // namespace tarsier::cli
