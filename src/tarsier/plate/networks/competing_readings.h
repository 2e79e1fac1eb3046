// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/text/reading.h"

#include <vector>

// Chooses among readings that overlap in an image.
namespace tarsier::plate {

// Marks the small lettering above and below the text of a certain plate of one row: towns, states,
// dealers. `plate` of the readings is the aligner's score.
[[nodiscard]] std::vector<bool> are_slogans(const std::vector<Reading>& readings);

// Keeps one reading of each group that competes for one plate. Highest confidence first.
[[nodiscard]] std::vector<Reading> suppress_competing(std::vector<Reading> readings);

}  // namespace tarsier::plate
