// SPDX-License-Identifier: MIT
#pragma once

#include <fmt/format.h>

#include <string>
#include <string_view>
#include <utility>

namespace tarsier {

enum class LogLevel { kDebug, kInfo, kWarning, kError, kOff };

// "debug", "info", "warning", "error", "off"; throws std::invalid_argument for anything else.
[[nodiscard]] LogLevel parse_log_level(std::string_view name);

// Lines below `level` are dropped. Thread-safe. The default is kInfo.
void set_log_level(LogLevel level);
[[nodiscard]] LogLevel log_level();

// Writes one line to stderr, "tarsier: [warning: ]<message>". Control characters are escaped, so
// that a hostile file name cannot control the terminal. Thread-safe.
void log_line(LogLevel level, std::string_view message);

template <typename... Args>
void log_debug(fmt::format_string<Args...> format, Args&&... args) {
  if (log_level() <= LogLevel::kDebug) {
    log_line(LogLevel::kDebug, fmt::format(format, std::forward<Args>(args)...));
  }
}
template <typename... Args>
void log_info(fmt::format_string<Args...> format, Args&&... args) {
  if (log_level() <= LogLevel::kInfo) {
    log_line(LogLevel::kInfo, fmt::format(format, std::forward<Args>(args)...));
  }
}
template <typename... Args>
void log_warning(fmt::format_string<Args...> format, Args&&... args) {
  if (log_level() <= LogLevel::kWarning) {
    log_line(LogLevel::kWarning, fmt::format(format, std::forward<Args>(args)...));
  }
}
template <typename... Args>
void log_error(fmt::format_string<Args...> format, Args&&... args) {
  if (log_level() <= LogLevel::kError) {
    log_line(LogLevel::kError, fmt::format(format, std::forward<Args>(args)...));
  }
}

// `text` with control characters and invalid bytes written as \xNN; line breaks as \n.
[[nodiscard]] std::string printable(std::string_view text);

}  // namespace tarsier
