// SPDX-License-Identifier: MIT
#pragma once

#include <string>

namespace tarsier::cli {

// Parses "2GB", "800MB" or "1.5" (GB); returns GB. Throws UsageError unless it is 250MB..1024GB.
[[nodiscard]] double parse_memory(const std::string& text);

}  // namespace tarsier::cli
