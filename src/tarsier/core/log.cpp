// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"

#include "tarsier/core/name_table.h"

#include <atomic>
#include <cstdio>
#include <mutex>

namespace tarsier {
namespace {

std::atomic<LogLevel> g_level{LogLevel::kInfo};
std::mutex g_mutex;

}  // namespace

LogLevel parse_log_level(std::string_view name) {
  constexpr NameTable<LogLevel, 5> kLevels{"log level",
                                           {{{LogLevel::kDebug, "debug"},
                                             {LogLevel::kInfo, "info"},
                                             {LogLevel::kWarning, "warning"},
                                             {LogLevel::kError, "error"},
                                             {LogLevel::kOff, "off"}}}};
  return kLevels.parse(name);
}

void set_log_level(LogLevel level) { g_level = level; }
LogLevel log_level() { return g_level; }

std::string printable(std::string_view text) {
  std::string result;
  result.reserve(text.size());
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    if (c == '\n') {
      result += "\\n";
    } else if (byte < 0x20 || byte == 0x7f) {
      result += fmt::format("\\x{:02x}", byte);
    } else {
      result += c;
    }
  }
  return result;
}

void log_line(LogLevel level, std::string_view message) {
  if (level < g_level || level == LogLevel::kOff) return;
  const char* prefix = level == LogLevel::kWarning ? "warning: "
                       : level == LogLevel::kError ? "error: "
                       : level == LogLevel::kDebug ? "debug: "
                                                   : "";
  const std::string line = fmt::format("tarsier: {}{}\n", prefix, printable(message));
  const std::lock_guard lock(g_mutex);
  std::fwrite(line.data(), 1, line.size(), stderr);
}

}  // namespace tarsier
