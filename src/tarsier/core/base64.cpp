// SPDX-License-Identifier: MIT
#include "tarsier/core/base64.h"

#include <algorithm>
#include <array>

namespace tarsier {
namespace {

constexpr std::string_view kAlphabet =
    "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

constexpr std::array<std::int8_t, 256> make_decoding_table() {
  std::array<std::int8_t, 256> table{};
  table.fill(-1);
  for (std::size_t i = 0; i < kAlphabet.size(); ++i) {
    table[static_cast<unsigned char>(kAlphabet[i])] = static_cast<std::int8_t>(i);
  }
  return table;
}

}  // namespace

std::string to_base64(std::span<const std::uint8_t> bytes) {
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t count = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t group = 0;
    for (std::size_t k = 0; k < 3; ++k) group = group << 8U | (k < count ? bytes[i + k] : 0U);
    for (unsigned k = 0; k < 4; ++k)
      text += k <= count ? kAlphabet[group >> (18 - 6 * k) & 0x3FU] : '=';
  }
  return text;
}

std::string to_base64(std::string_view bytes) {
  return to_base64(std::span(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()));
}

std::optional<std::size_t> base64_size(std::string_view text) {
  if (text.size() % 4 != 0) return std::nullopt;
  const std::size_t padding = text.ends_with("==") ? 2 : text.ends_with('=') ? 1 : 0;
  return text.size() / 4 * 3 - padding;
}

bool from_base64(std::string_view text, std::span<std::uint8_t> bytes) {
  static constexpr auto kTable = make_decoding_table();
  if (base64_size(text) != bytes.size()) return false;
  const auto value = [&](std::size_t i) {
    return int{kTable[static_cast<unsigned char>(text[i])]};
  };
  const std::size_t full_groups = bytes.size() / 3;
  int invalid = 0;  // negative after an invalid letter
  for (std::size_t i = 0; i < full_groups; ++i) {
    const int a = value(4 * i), b = value(4 * i + 1), c = value(4 * i + 2), d = value(4 * i + 3);
    invalid |= a | b | c | d;
    bytes[3 * i] = static_cast<std::uint8_t>(a << 2 | b >> 4);
    bytes[3 * i + 1] = static_cast<std::uint8_t>(b << 4 | c >> 2);
    bytes[3 * i + 2] = static_cast<std::uint8_t>(c << 6 | d);
  }
  if (const std::size_t rest = bytes.size() % 3; rest > 0) {
    const int a = value(4 * full_groups), b = value(4 * full_groups + 1);
    const int c = rest == 2 ? value(4 * full_groups + 2) : 0;
    invalid |= a | b | c;
    bytes[3 * full_groups] = static_cast<std::uint8_t>(a << 2 | b >> 4);
    if (rest == 2) bytes[3 * full_groups + 1] = static_cast<std::uint8_t>(b << 4 | c >> 2);
  }
  return invalid >= 0;
}

std::optional<std::vector<std::uint8_t>> from_base64(std::string_view text) {
  const auto size = base64_size(text);
  if (!size) return std::nullopt;
  std::vector<std::uint8_t> bytes(*size);
  if (!from_base64(text, bytes)) return std::nullopt;
  return bytes;
}

}  // namespace tarsier
