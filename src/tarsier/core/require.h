// SPDX-License-Identifier: MIT
#pragma once

#include <fmt/format.h>

#include <source_location>
#include <stdexcept>
#include <string>

namespace tarsier::detail {

[[noreturn]] void fail_requirement(const char* expression, const std::string& message,
                                   const std::source_location& where);

}  // namespace tarsier::detail

// Throws std::invalid_argument that names the expression. The message is formatted only on failure.
// For mistakes of the caller, never for "nothing was found".
#define TARSIER_REQUIRE(expression, ...)                                           \
  do {                                                                             \
    if (!(expression)) {                                                           \
      ::tarsier::detail::fail_requirement(#expression, ::fmt::format(__VA_ARGS__), \
                                          ::std::source_location::current());      \
    }                                                                              \
  } while (false)
