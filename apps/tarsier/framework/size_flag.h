// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/types.hpp>

#include <string>

namespace tarsier::cli {

// Parses "1280x720". Throws UsageError, which says what was expected, unless both sides are
// min_side..max_side px.
[[nodiscard]] cv::Size parse_size(const std::string& text, int min_side, int max_side);

}  // namespace tarsier::cli
