// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>

namespace tarsier {

// Maps an index to a 32-bit number: multiples of 2^32 / golden ratio, which are evenly distributed
// (Knuth, The art of computer programming, volume 3, 6.4). Used for pseudo-random orders and shares
// that are the same in each run.
[[nodiscard]] constexpr std::uint32_t mixed_index(int index) {
  return static_cast<std::uint32_t>(index) * 2654435769U;
}

}  // namespace tarsier
