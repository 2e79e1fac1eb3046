// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/text/reading.h"

#include <vector>

// Which of the readings that overlap in an image are plates.
namespace tarsier::plate {

// ln(p / (1 - p)), p kept 1e-4 from both ends.
[[nodiscard]] double logit(double p);
// ln of the reading's confidence, at least ln 1e-5.
[[nodiscard]] double log_confidence(const Reading& reading);

// Without the small lettering above and below the text of a sure plate of one row: towns, states,
// dealers. Keeps the order.
[[nodiscard]] std::vector<Reading> without_slogans(const std::vector<Reading>& readings);

// Of rivals for one place one stays. Surest first.
[[nodiscard]] std::vector<Reading> without_rivals(std::vector<Reading> readings);

}  // namespace tarsier::plate
