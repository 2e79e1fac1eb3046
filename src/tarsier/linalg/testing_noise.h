// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"

#include <cstddef>
#include <vector>

namespace tarsier::linalg {

// Normally distributed numbers, for tests.
inline std::vector<float> noise(std::size_t count, Rng& rng) {
  std::vector<float> values(count);
  for (float& value : values) value = static_cast<float>(rng.normal());
  return values;
}

}  // namespace tarsier::linalg
