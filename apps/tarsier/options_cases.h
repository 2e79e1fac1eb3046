// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <functional>
#include <memory>
#include <string>
#include <vector>

// The structs of options with fields(), for options_test.cpp. They are in files of their own
// because they need the headers of every module.

namespace tarsier::cli {

// The tests of one struct of options.
struct OptionsCase {
  std::string name;
  OptionFields fields;
  // They throw std::invalid_argument for values out of range. The first checks only the ranges, the
  // second all rules.
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

// One source file each.
[[nodiscard]] std::vector<OptionsCase> face_options();
[[nodiscard]] std::vector<OptionsCase> plate_options();  // and all other options
[[nodiscard]] std::vector<OptionsCase> scene_options();

}  // namespace tarsier::cli
