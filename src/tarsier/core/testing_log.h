// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/log.h"

namespace tarsier {

// Sets the log level for the lifetime of the object and then restores the previous one, so that a
// test does not change the log of the tests after it.
class ScopedLogLevel {
 public:
  explicit ScopedLogLevel(LogLevel level) : before_(log_level()) { set_log_level(level); }
  ~ScopedLogLevel() { set_log_level(before_); }
  ScopedLogLevel(const ScopedLogLevel&) = delete;
  ScopedLogLevel& operator=(const ScopedLogLevel&) = delete;

 private:
  LogLevel before_;
};

}  // namespace tarsier
