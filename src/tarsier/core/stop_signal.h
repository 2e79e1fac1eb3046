// SPDX-License-Identifier: MIT
#pragma once

namespace tarsier {

// The signal that triggered the token of stop_on_signals() (stop.h): SIGINT or SIGTERM; 0 before
// the first one.
[[nodiscard]] int stop_signal();

}  // namespace tarsier
