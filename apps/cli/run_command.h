// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>

namespace tarsier::cli {

// Runs `command` by /bin/sh with `input` and a line break on its stdin and its output on our
// stderr, and waits for it, 10 s at most; then it is ended. Nothing of `input` is part of the
// command, so no name can break out of it. A command that fails is warned of.
void run_command(const std::string& command, std::string_view input);

}  // namespace tarsier::cli
