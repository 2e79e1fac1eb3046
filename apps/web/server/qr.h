// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::web {

// A QR code (ISO/IEC 18004, model 2) of bytes, error correction level L, versions 1 to 10, up to
// 271 bytes; the mask has the lowest penalty.
struct QrCode {
  int size = 0;               // modules per side, 21 + 4 (version - 1)
  std::vector<bool> is_dark;  // row by row
  [[nodiscard]] bool at(int row, int column) const {
    return is_dark[static_cast<std::size_t>(row * size + column)];
  }
};

// Throws std::invalid_argument for more than 271 bytes.
[[nodiscard]] QrCode make_qr_code(std::string_view bytes);

// Draws two rows of modules per line as half blocks, light on dark with a quiet zone of two
// modules. Both terminals and phones can read it.
[[nodiscard]] std::string draw_qr_code(const QrCode& code);

// Parts of the code: the error correction codewords for `data`, the bits that encode level and
// mask, and the bits that encode the version.
[[nodiscard]] std::vector<std::uint8_t> qr_error_correction(const std::vector<std::uint8_t>& data,
                                                            int count);
[[nodiscard]] unsigned qr_format_bits(int mask);
[[nodiscard]] unsigned qr_version_bits(int version);

}  // namespace tarsier::web
