// SPDX-License-Identifier: MIT
#pragma once

#include <span>
#include <string>

namespace tarsier::cli {

// Becomes the program `name` with these words behind its name: the process stays, so that its exit
// status, its signals and its streams are those of the other program. It lies beside this one, as
// built, or in ../libexec/tarsier, as installed. Throws InputError where it is missing or cannot be
// started; returns never.
[[noreturn]] void become_companion(const std::string& name, std::span<const std::string> words);

}  // namespace tarsier::cli
