// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace tarsier::cli {

// A message of the library in the words of the program. The library does not know how its caller sets an option, and writes
// "option 'ca_file'" with the name of the field; here this becomes the flag of that name, "--ca-file", where it is one of `flags`;
// "option 'memory_gb'" also the flag "--memory", without the unit. All else stays.
[[nodiscard]] std::string with_flag_names(std::string_view message,
                                          const std::vector<std::string>& flags);

}  // namespace tarsier::cli
