// SPDX-License-Identifier: MIT
#include "verbs/sfm/memory_flag.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/words.h"

#include <fmt/format.h>

#include <string_view>
#include <utility>

namespace tarsier::cli {

double parse_memory(const std::string& text) {
  const std::string lower = lower_case(trimmed(text));
  std::string_view number = lower;
  double unit = 1;
  for (const auto& [ending, factor] :
       {std::pair<std::string_view, double>{"gb", 1.0}, {"g", 1.0}, {"mb", 1e-3}, {"m", 1e-3}}) {
    if (number.ends_with(ending)) {
      number.remove_suffix(ending.size());
      unit = factor;
      break;
    }
  }
  const auto value = to_number(trimmed(number));
  if (!value || !(*value * unit >= 0.25 && *value * unit <= 1024))
    throw UsageError(fmt::format("--memory '{}': expected 250MB..1024GB", printable(text)));
  return *value * unit;
}

}  // namespace tarsier::cli
