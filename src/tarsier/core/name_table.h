// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace tarsier {

// "unknown MODE 'crayon': sketch, paint or cartoon".
[[nodiscard]] std::string unknown_name(std::string_view what, std::string_view text,
                                       const std::vector<std::string>& known);

// The names of an enumeration's values, in the order in which help texts list them. One table
// serves name_of(), parse_..() and the choices of a flag, so the three always agree:
//
//   constexpr NameTable<Mode, 2> kModes{"mode", {{{Mode::kSketch, "sketch"}, {Mode::kPaint, "paint"}}}};
//   kModes.parse("paint");  // Mode::kPaint
template <typename Value, std::size_t N>
struct NameTable {
  std::string_view what;  // what the names are names of; for messages
  std::array<std::pair<Value, std::string_view>, N> names;

  // "" for a value without a name.
  [[nodiscard]] constexpr std::string_view name(Value value) const {
    for (const auto& [known, text] : names)
      if (known == value) return text;
    return "";
  }
  [[nodiscard]] constexpr std::optional<Value> find(std::string_view text) const {
    for (const auto& [value, known] : names)
      if (known == text) return value;
    return std::nullopt;
  }
  [[nodiscard]] std::vector<std::string> choices() const {
    std::vector<std::string> all;
    all.reserve(names.size());
    for (const auto& [value, known] : names) all.emplace_back(known);
    return all;
  }
  // Throws std::invalid_argument(unknown_name(..)).
  [[nodiscard]] Value parse(std::string_view text) const {
    if (const auto value = find(text)) return *value;
    throw std::invalid_argument(unknown_name(what, text, choices()));
  }
};

}  // namespace tarsier
