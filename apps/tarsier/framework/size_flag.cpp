// SPDX-License-Identifier: MIT
#include "framework/size_flag.h"

#include "tarsier/core/errors.h"

#include <fmt/format.h>

#include <charconv>

namespace tarsier::cli {

cv::Size parse_size(const std::string& text, int min_side, int max_side) {
  cv::Size size;
  const char* const end = text.data() + text.size();
  const auto [at, error] = std::from_chars(text.data(), end, size.width);
  if (error == std::errc() && at != end && *at == 'x') {
    const auto [last, more] = std::from_chars(at + 1, end, size.height);
    if (more == std::errc() && last == end && size.width >= min_side && size.height >= min_side &&
        size.width <= max_side && size.height <= max_side) {
      return size;
    }
  }
  throw UsageError(fmt::format("--size '{}': expected {}x{} .. {}x{}, like 1280x720", text,
                               min_side, min_side, max_side, max_side));
}

}  // namespace tarsier::cli
