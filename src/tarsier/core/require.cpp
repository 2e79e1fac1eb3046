// SPDX-License-Identifier: MIT
#include "tarsier/core/require.h"

namespace tarsier::detail {

void fail_requirement(const char* expression, const std::string& message,
                      const std::source_location& where) {
  throw std::invalid_argument(
      fmt::format("{}: requires {}: {}", where.function_name(), expression, message));
}

}  // namespace tarsier::detail
