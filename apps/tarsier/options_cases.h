// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <functional>
#include <memory>
#include <string>
#include <vector>

// The structs of options that have fields(), as options_test.cpp tests them. In files of their own:
// they need the headers of every module.

namespace tarsier::cli {

// What is tested of a struct of options.
struct OptionsCase {
  std::string name;
  OptionFields fields;
  // Throws std::invalid_argument for values out of their ranges. The first looks at the ranges
  // alone, the second at all rules.
  std::function<void()> check_ranges, check;
};

template <class Options>
OptionsCase options_case(const char* name) {
  const auto options = std::make_shared<Options>();
  const auto ranges = [options] { check_fields(*options); };
  if constexpr (requires { options->check(); }) {
    return {name, options->fields(), ranges, [options] { options->check(); }};
  } else {
    return {name, options->fields(), ranges, ranges};
  }
}

// One file each.
[[nodiscard]] std::vector<OptionsCase> face_options();
[[nodiscard]] std::vector<OptionsCase> plate_options();  // and those of what remains
[[nodiscard]] std::vector<OptionsCase> scene_options();

}  // namespace tarsier::cli
