// SPDX-License-Identifier: MIT
#pragma once

#include <string_view>

namespace tarsier {

// A length on the command line, "25mm", "2.5cm", "0.025m" or "0.025" (metres), in metres: positive,
// finite, up to 1000 m. Throws UsageError, which begins with `what` ("square").
[[nodiscard]] double parse_length(std::string_view text, std::string_view what);

}  // namespace tarsier
