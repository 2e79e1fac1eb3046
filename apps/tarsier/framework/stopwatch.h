// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/elapsed.h"
#include "tarsier/core/statistics.h"

#include <chrono>
#include <utility>
#include <vector>

namespace tarsier::cli {

// Measures the time since its construction.
class Stopwatch {
 public:
  [[nodiscard]] double seconds() const { return seconds_since(start_); }
  [[nodiscard]] double ms() const { return 1000 * seconds(); }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

// The median of `repeats` runs, >= 1, in ms, after one warm-up run that is not counted.
template <class Run>
[[nodiscard]] double median_ms(int repeats, const Run& run) {
  run();
  std::vector<double> times;
  for (int i = 0; i < repeats; ++i) {
    const Stopwatch watch;
    run();
    times.push_back(watch.ms());
  }
  return upper_median(std::move(times));
}

}  // namespace tarsier::cli
