// SPDX-License-Identifier: MIT
#pragma once

#include <string_view>

namespace tarsier {

// Parses a length of the command line, "25mm", "2.5cm", "0.025m" or "0.025" (metres). Returns
// metres: positive, finite, up to 1000 m. Throws UsageError, whose message begins with `what`
// ("square"), also for a number of 1 and more without a unit, because "25" usually means mm.
[[nodiscard]] double parse_length(std::string_view text, std::string_view what);

}  // namespace tarsier
