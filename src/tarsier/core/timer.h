// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier {

// Statistics of one named timer, in milliseconds.
struct TimerStats {
  std::string name;
  std::int64_t runs = 0;
  double last_ms = 0;
  double min_ms = 0;
  double max_ms = 0;
  double total_ms = 0;
  [[nodiscard]] double average_ms() const {
    return runs > 0 ? total_ms / static_cast<double>(runs) : 0;
  }
};

// Named timers over repeated runs, in the order of their first use. Thread-safe. Usage:
//   const auto scope = timers.time("median");   // measures until the end of the block
class Timers {
 public:
  class Scope {
   public:
    // If `timers` is null nothing is measured.
    Scope(Timers* timers, std::string_view name)
        : timers_(timers), name_(name), start_(std::chrono::steady_clock::now()) {}
    ~Scope() {
      if (timers_ == nullptr) return;
      const auto spent = std::chrono::steady_clock::now() - start_;
      timers_->add(name_, std::chrono::duration<double, std::milli>(spent).count());
    }
    Scope(const Scope&) = delete;
    Scope& operator=(const Scope&) = delete;

   private:
    Timers* timers_;
    std::string_view name_;
    std::chrono::steady_clock::time_point start_;
  };

  // `name` must live as long as the scope (a literal does).
  [[nodiscard]] Scope time(std::string_view name) { return {this, name}; }
  void add(std::string_view name, double ms);

  [[nodiscard]] std::vector<TimerStats> stats() const;
  // A table with the columns name, runs, last, average, min, max (ms).
  [[nodiscard]] std::string report() const;

 private:
  mutable std::mutex mutex_;
  std::vector<TimerStats> stats_;
};

}  // namespace tarsier
