// SPDX-License-Identifier: MIT
#pragma once

#include <ctime>

// Processor time in ms, which other work on the machine does not increase.
namespace tarsier::cli {

[[nodiscard]] inline double cpu_ms_of(clockid_t clock) {
  timespec now{};
  clock_gettime(clock, &now);
  return 1e3 * static_cast<double>(now.tv_sec) + 1e-6 * static_cast<double>(now.tv_nsec);
}

[[nodiscard]] inline double thread_cpu_ms() { return cpu_ms_of(CLOCK_THREAD_CPUTIME_ID); }
[[nodiscard]] inline double process_cpu_ms() { return cpu_ms_of(CLOCK_PROCESS_CPUTIME_ID); }

}  // namespace tarsier::cli
