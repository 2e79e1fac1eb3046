// SPDX-License-Identifier: MIT
#pragma once

#include <exception>
#include <string>

namespace tarsier::cli {

// The advice that the program appends to the message of a library error, in terms of its verbs: ":
// recompute them with `people train --template deep`". Empty if the message needs no advice.
[[nodiscard]] std::string error_help(const std::exception& error);

}  // namespace tarsier::cli
