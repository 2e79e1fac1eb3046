// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

// Base64 encoding with the standard alphabet (RFC 4648, section 4), with padding, without line
// breaks.
namespace tarsier {

[[nodiscard]] std::string to_base64(std::span<const std::uint8_t> bytes);
[[nodiscard]] std::string to_base64(std::string_view bytes);

// The number of bytes that the text encodes; nullopt if its length is not a multiple of 4.
// from_base64() may still refuse the text.
[[nodiscard]] std::optional<std::size_t> base64_size(std::string_view text);

// Decodes into `bytes`, whose size must be base64_size(text). Returns false for another size or for
// a character that is not of the alphabet (spaces, line breaks, padding elsewhere than at the end);
// `bytes` are then undefined. Unused bits in the last letter before the padding are ignored.
[[nodiscard]] bool from_base64(std::string_view text, std::span<std::uint8_t> bytes);

// Decodes into a new vector; nullopt where the overload above returns false.
[[nodiscard]] std::optional<std::vector<std::uint8_t>> from_base64(std::string_view text);

}  // namespace tarsier
