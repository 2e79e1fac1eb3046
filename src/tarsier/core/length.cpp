// SPDX-License-Identifier: MIT
#include "tarsier/core/length.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"

#include <fmt/format.h>

#include <charconv>
#include <string>

namespace tarsier {

double parse_length(std::string_view text, std::string_view what) {
  constexpr double kMaxLength_m = 1000;  // m
  double value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const std::string_view unit =
      text.substr(error == std::errc{} ? static_cast<std::size_t>(end - text.data()) : 0);
  double factor = 0;
  if (unit.empty() || unit == "m") factor = 1;
  if (unit == "cm") factor = 1e-2;
  if (unit == "mm") factor = 1e-3;
  if (error == std::errc{} && unit.empty() && value >= 1) {
    throw UsageError(fmt::format("{} '{}' has no unit: write {}mm, {}cm or {}m", what,
                                 printable(std::string(text.substr(0, 60))), text, text, text));
  }
  const double length = value * factor;
  if (error != std::errc{} || !(length > 0 && length <= kMaxLength_m)) {
    throw UsageError(
        fmt::format("{} '{}': a length such as 25mm, 2.5cm or 0.025m is expected (more than 0, up "
                    "to {} m)",
                    what, printable(std::string(text.substr(0, 60))), kMaxLength_m));
  }
  return length;
}

}  // namespace tarsier
