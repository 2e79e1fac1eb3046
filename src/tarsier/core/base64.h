// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

// Bytes as text: base64 with the standard alphabet (RFC 4648, section 4), with padding, without line
// breaks.
namespace tarsier {

[[nodiscard]] std::string to_base64(std::span<const std::uint8_t> bytes);
[[nodiscard]] std::string to_base64(std::string_view bytes);

// How many bytes the text stands for; nothing if its length is no multiple of 4. The text may still
// be refused by from_base64().
[[nodiscard]] std::optional<std::size_t> base64_size(std::string_view text);

// Decodes into `bytes`, whose size must be base64_size(text). False, and `bytes` have no meaning, for
// another size or a character that is not of the alphabet: spaces, line breaks, padding elsewhere than
// at the end. Bits that no byte needs, in the last letter before the padding, are ignored.
[[nodiscard]] bool from_base64(std::string_view text, std::span<std::uint8_t> bytes);

// The same into a new list; nothing where it would be false.
[[nodiscard]] std::optional<std::vector<std::uint8_t>> from_base64(std::string_view text);

}  // namespace tarsier
