// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"
#include <string_view>

namespace tarsier::cli {

// The areas of tarsier, with their verbs and examples: the one that context.words begin with, where
// they need no other; else all.
void add_areas(Command& app, Context& context);

// `tarsier --help`
[[nodiscard]] std::string_view main_help();

}  // namespace tarsier::cli
