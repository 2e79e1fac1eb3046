// SPDX-License-Identifier: MIT
#pragma once

#include <span>
#include <string>

namespace tarsier::cli {

// Replaces this process by the program `name` with the arguments `words`. The process id stays, so
// exit status, signals and streams are those of the other program. The program is searched beside
// this one (build tree), then in ../libexec/tarsier (installed). Throws InputError if it is missing
// or cannot be started; else does not return.
[[noreturn]] void become_companion(const std::string& name, std::span<const std::string> words);

}  // namespace tarsier::cli
