// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/media/frame_source.h"

#include <vector>

namespace tarsier::cli {

// The schemes that all inputs may use: synth:NAME?key=value&.., viewer:NAME.
[[nodiscard]] std::vector<Scheme> input_schemes();

}  // namespace tarsier::cli
