// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"
#include <string_view>

namespace tarsier::cli {

// Adds the areas of tarsier, with their verbs and examples. Adds only the area that context.words
// begin with where no other is needed; else all.
void add_areas(Command& app, Context& context);

// `tarsier --help`
[[nodiscard]] std::string_view main_help();

}  // namespace tarsier::cli
