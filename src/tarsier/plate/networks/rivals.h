// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/text/reading.h"

#include <vector>

// Which of the readings that overlap in an image are plates.
namespace tarsier::plate {

// Which of them are the small lettering above and below the text of a sure plate of one row: towns,
// states, dealers. `plate` of the readings is the aligner's score.
[[nodiscard]] std::vector<bool> are_slogans(const std::vector<Reading>& readings);

// Of rivals for one place one stays. Surest first.
[[nodiscard]] std::vector<Reading> without_rivals(std::vector<Reading> readings);

}  // namespace tarsier::plate
