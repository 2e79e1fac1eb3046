// SPDX-License-Identifier: MIT
#pragma once

#include <exception>
#include <string>

namespace tarsier::cli {

// What the verbs of the program can do about an error of the library, to be written behind its message: ": `people train
// --template deep` makes them again". Empty for an error that says it all.
[[nodiscard]] std::string error_help(const std::exception& error);

}  // namespace tarsier::cli
