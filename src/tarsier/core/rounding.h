// SPDX-License-Identifier: MIT
#pragma once

#include <cmath>

namespace tarsier {

// The nearest multiple of 1 / `steps`: 1e3 for three decimals.
[[nodiscard]] inline double rounded_to_steps(double value, double steps) {
  return std::round(value * steps) / steps;
}

}  // namespace tarsier
