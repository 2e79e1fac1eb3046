// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/synth/plates.h"

#include <string>
#include <vector>

namespace tarsier::synth {

// The rows of a plate of this kind, with groups separated by single spaces. `text` is split
// according to the kind (its own spaces are kept; a '|' or the kind's two rows break the row). If
// it is empty, a random text is generated (with `any_text` often groups of arbitrary symbols).
// Throws std::invalid_argument for symbols that no plate has.
[[nodiscard]] std::vector<std::string> plate_text(PlateKind kind, const std::string& text,
                                                  bool any_text, Rng& rng);

}  // namespace tarsier::synth
