// SPDX-License-Identifier: MIT
#pragma once

namespace tarsier {

// The signal that fired the token of stop_on_signals() (stop.h): SIGINT or SIGTERM; 0: none yet.
[[nodiscard]] int stop_signal();

}  // namespace tarsier
