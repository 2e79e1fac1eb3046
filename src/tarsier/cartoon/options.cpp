// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/options.h"

#include "tarsier/core/require.h"

#include <fmt/ranges.h>

#include <array>
#include <string>
#include <utility>

namespace tarsier::cartoon {
namespace {

constexpr std::array<std::pair<Mode, std::string_view>, 8> kModeNames{
    {{Mode::kSketch, "sketch"},
     {Mode::kPaint, "paint"},
     {Mode::kCartoon, "cartoon"},
     {Mode::kEvil, "evil"},
     {Mode::kEvilSketch, "evil-sketch"},
     {Mode::kAlien, "alien"},
     {Mode::kSmooth, "smooth"},
     {Mode::kNone, "none"}}};

constexpr std::array<std::pair<Quality, std::string_view>, 3> kQualityNames{
    {{Quality::kReference, "reference"}, {Quality::kFast, "fast"}, {Quality::kDraft, "draft"}}};

template <typename Table, typename Value>
std::string_view find_name(const Table& table, Value value) {
  for (const auto& [candidate, name] : table) {
    if (candidate == value) return name;
  }
  return "?";
}

template <typename Table>
auto find_value(const Table& table, std::string_view wanted, std::string_view what) {
  std::vector<std::string_view> names;
  for (const auto& [value, name] : table) {
    if (name == wanted) return value;
    names.push_back(name);
  }
  TARSIER_REQUIRE(false, "unknown {} '{}' ({})", what, wanted, fmt::join(names, ", "));
  return table.front().first;
}

bool is_byte(int value) { return value >= 0 && value <= 255; }

}  // namespace

std::string_view name_of(Mode mode) { return find_name(kModeNames, mode); }
Mode parse_mode(std::string_view name) { return find_value(kModeNames, name, "mode"); }

const std::vector<Mode>& all_modes() {
  static const std::vector<Mode> modes = [] {
    std::vector<Mode> list;
    for (const auto& entry : kModeNames) list.push_back(entry.first);
    return list;
  }();
  return modes;
}

bool uses_skin(Mode mode) { return mode == Mode::kAlien || mode == Mode::kSmooth; }

std::string_view name_of(Quality quality) { return find_name(kQualityNames, quality); }
Quality parse_quality(std::string_view name) { return find_value(kQualityNames, name, "quality"); }

void CartoonOptions::check() const {
  check_fields(sketch);
  check_fields(paint);
  check_fields(evil);
  check_fields(skin);
  check_fields(steady);
  for (int c = 0; c < 3; ++c) {
    TARSIER_REQUIRE(skin.color[c] >= 0 && skin.color[c] <= 255, "skin colour is 0..255, got {}",
                    skin.color[c]);
    const auto i = static_cast<size_t>(c);
    TARSIER_REQUIRE(is_byte(skin.lower.at(i)) && is_byte(skin.upper.at(i)),
                    "skin differences are 0..255, got -{} +{}", skin.lower.at(i), skin.upper.at(i));
  }
}

}  // namespace tarsier::cartoon
