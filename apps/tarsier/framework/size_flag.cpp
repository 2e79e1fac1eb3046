// SPDX-License-Identifier: MIT
#include "framework/size_flag.h"

#include "tarsier/core/errors.h"

#include <fmt/format.h>

#include <charconv>

namespace tarsier::cli {

cv::Size parse_size(const std::string& text, int least, int most) {
  cv::Size size;
  const char* const end = text.data() + text.size();
  const auto [at, error] = std::from_chars(text.data(), end, size.width);
  if (error == std::errc() && at != end && *at == 'x') {
    const auto [last, more] = std::from_chars(at + 1, end, size.height);
    if (more == std::errc() && last == end && size.width >= least && size.height >= least &&
        size.width <= most && size.height <= most) {
      return size;
    }
  }
  throw UsageError(fmt::format("--size '{}': expected {}x{} .. {}x{}, like 1280x720", text, least,
                               least, most, most));
}

}  // namespace tarsier::cli
