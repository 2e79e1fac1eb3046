// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/stream_security.h"

#include "framework/cli.h"
#include <vector>

namespace tarsier::cli {

// --ca-file and --insecure, of every verb that may read an https or rtsps address. Returns them, to
// be grouped.
std::vector<Flag*> add_security_flags(Command& verb, StreamSecurity& security);

}  // namespace tarsier::cli
