// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/synth/plates.h"

#include <string>
#include <vector>

namespace tarsier::synth {

// The rows of a plate of this kind, groups separated by single spaces: `text` broken as the kind
// does (its own spaces count; a '|' or the kind's two rows break the row), or a random text when it
// is empty (with `any_text` often groups of anything). Throws std::invalid_argument for symbols
// that no plate has.
[[nodiscard]] std::vector<std::string> plate_text(PlateKind kind, const std::string& text,
                                                  bool any_text, Rng& rng);

}  // namespace tarsier::synth
