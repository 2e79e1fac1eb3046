// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/stream_security.h"

#include "framework/cli.h"
#include <vector>

namespace tarsier::cli {

// Adds --ca-file and --insecure, for verbs that may read an https or rtsps address. Returns them
// for grouping.
std::vector<Flag*> add_security_flags(Command& verb, StreamSecurity& security);

}  // namespace tarsier::cli
