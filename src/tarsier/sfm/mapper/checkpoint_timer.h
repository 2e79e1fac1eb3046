// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>

// Internal to the mapper.
namespace tarsier::sfm {

// When to write checkpoints.
class CheckpointTimer {
 public:
  // Whether `interval_s` and 20 times the duration of the last writing have passed since then. With
  // 0 each step is due.
  [[nodiscard]] bool is_due(double interval_s) const {
    const double since = seconds_since(saved_at_);
    return since >= interval_s && (interval_s <= 0 || since >= 20 * saving_s_);
  }
  template <typename Write>
  void save(const Write& write) {
    const Clock::time_point start = Clock::now();
    write();
    saved_at_ = Clock::now();
    saving_s_ = seconds_since(start);
  }

 private:
  using Clock = std::chrono::steady_clock;
  static double seconds_since(Clock::time_point start) {
    return std::chrono::duration<double>(Clock::now() - start).count();
  }

  Clock::time_point saved_at_ = Clock::now();
  double saving_s_ = 0;
};

}  // namespace tarsier::sfm
