// SPDX-License-Identifier: MIT
#pragma once

#include <bit>
#include <cstdint>
#include <string>

// Numbers in binary files (PLY, GLB), little endian.
namespace tarsier::sfm {

inline void put(std::string& bytes, std::uint32_t value) {
  for (int shift = 0; shift < 32; shift += 8) bytes.push_back(static_cast<char>(value >> shift));
}
inline void put(std::string& bytes, float value) {
  put(bytes, std::bit_cast<std::uint32_t>(value));
}
inline void put(std::string& bytes, double value) {
  const auto word = std::bit_cast<std::uint64_t>(value);
  put(bytes, static_cast<std::uint32_t>(word));
  put(bytes, static_cast<std::uint32_t>(word >> 32));
}

}  // namespace tarsier::sfm
