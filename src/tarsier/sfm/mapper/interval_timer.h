// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>

// Internal to the mappers.
namespace tarsier::sfm {

// When to repeat work that should take less than a twentieth of the time, such as writing a
// checkpoint.
class IntervalTimer {
 public:
  // Whether `interval_s` and 20 times the duration of the last work have passed since then. With 0
  // each step is due.
  [[nodiscard]] bool is_due(double interval_s) const {
    const double since = seconds_since(done_at_);
    return since >= interval_s && (interval_s <= 0 || since >= 20 * work_s_);
  }
  template <typename Work>
  void run(const Work& work) {
    const Clock::time_point start = Clock::now();
    work();
    done_at_ = Clock::now();
    work_s_ = seconds_since(start);
  }

 private:
  using Clock = std::chrono::steady_clock;
  static double seconds_since(Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
  }

  Clock::time_point done_at_ = Clock::now();
  double work_s_ = 0;
};

}  // namespace tarsier::sfm
