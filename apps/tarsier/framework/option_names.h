// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace tarsier::cli {

// Replaces option names in a message of the library by flags of the program. The library writes
// "option 'ca_file'", with the name of the field, because it does not know how its caller sets
// options. The name becomes the flag "--ca-file" if that is one of `flags`; "option 'memory_gb'"
// also becomes "--memory", without the unit. All other text is unchanged.
[[nodiscard]] std::string with_flag_names(std::string_view message,
                                          const std::vector<std::string>& flags);

}  // namespace tarsier::cli
