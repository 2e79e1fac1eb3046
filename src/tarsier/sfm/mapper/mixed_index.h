// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>

namespace tarsier::sfm {

// A number of 32 bits for each index: multiples of 2^32 / golden ratio, which are spread evenly over all of them (Knuth, The
// art of computer programming, volume 3, 6.4). For an order that mixes things, and for shares of them, the same in each run.
[[nodiscard]] constexpr std::uint32_t mixed_index(int index) {
  return static_cast<std::uint32_t>(index) * 2654435769U;
}

}  // namespace tarsier::sfm
