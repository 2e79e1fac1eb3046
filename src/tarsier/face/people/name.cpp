// SPDX-License-Identifier: MIT
#include "tarsier/face/people/name.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"

#include <fmt/format.h>

#include <cstdint>
#include <string>

namespace tarsier::face::people {

bool is_utf8(std::string_view text) {
  for (std::size_t i = 0; i < text.size();) {
    const auto first = static_cast<unsigned char>(text[i]);
    if (first < 0x80) {
      ++i;
      continue;
    }
    const int continuation_bytes = first >= 0xF0 ? 3 : first >= 0xE0 ? 2 : 1;
    if (first < 0xC2 || first > 0xF4 ||
        i + static_cast<std::size_t>(continuation_bytes) >= text.size())
      return false;
    std::uint32_t code = first & (0x3FU >> continuation_bytes);
    for (int k = 1; k <= continuation_bytes; ++k) {
      const auto next = static_cast<unsigned char>(text[i + static_cast<std::size_t>(k)]);
      if ((next & 0xC0) != 0x80) return false;
      code = (code << 6) | (next & 0x3FU);
    }
    const bool overlong =
        (continuation_bytes == 2 && code < 0x800) || (continuation_bytes == 3 && code < 0x10000);
    if (overlong || code > 0x10FFFF || (code >= 0xD800 && code < 0xE000)) return false;
    i += static_cast<std::size_t>(continuation_bytes) + 1;
  }
  return true;
}

void check_name(std::string_view name) {
  const std::string shown = printable(name.substr(0, 60));
  const auto refuse = [&](const std::string& reason) {
    throw UsageError(
        fmt::format("the name '{}{}' {}", shown, name.size() > 60 ? "..." : "", reason));
  };
  if (name.empty()) refuse("is empty");
  if (name.size() > kMaxNameBytes)
    refuse(fmt::format("has {} bytes, at most {} are allowed", name.size(), kMaxNameBytes));
  if (!is_utf8(name)) refuse("is not UTF-8");
  for (const char c : name)
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7F) refuse("has a control character");
  if (name.front() == ' ' || name.back() == ' ') refuse("begins or ends with a space");
}

void check_note(std::string_view note) {
  constexpr std::size_t kMaxNoteBytes = 10'000;
  if (note.size() > kMaxNoteBytes)
    throw UsageError(
        fmt::format("the note has {} bytes, at most {} are allowed", note.size(), kMaxNoteBytes));
  if (!is_utf8(note)) throw UsageError("the note is not UTF-8");
}

}  // namespace tarsier::face::people
