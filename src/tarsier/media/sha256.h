// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace tarsier {

// SHA-256 (FIPS 180-4). Pass bytes to add(), in pieces of any size, then call hex() once.
class Sha256 {
 public:
  void add(std::span<const std::uint8_t> bytes);
  void add(std::string_view bytes);
  // The 64 lower-case hexadecimal digits. Nothing may be added afterwards.
  [[nodiscard]] std::string hex();

 private:
  void add_block(const std::uint8_t* block);

  std::array<std::uint32_t, 8> state_{0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                      0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
  std::array<std::uint8_t, 64> pending_{};
  std::size_t pending_size_ = 0;  // bytes in pending_, < 64
  std::uint64_t size_ = 0;        // total bytes
};

// The hash of a file, which is read in pieces. Throws InputError (missing, a folder, unreadable).
[[nodiscard]] std::string sha256_of_file(const std::string& path);

}  // namespace tarsier
