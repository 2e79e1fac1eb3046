// SPDX-License-Identifier: MIT
#pragma once

#include <exception>
#include <string>

namespace tarsier::cli {

// The advice that the program appends to the message of a library error, in terms of its verbs: ":
// `people train --template deep` makes them again". Empty if the message needs no advice.
[[nodiscard]] std::string error_help(const std::exception& error);

}  // namespace tarsier::cli
