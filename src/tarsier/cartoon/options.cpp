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
  TARSIER_REQUIRE(sketch.median_size % 2 == 1 && sketch.median_size >= 3 && sketch.median_size <= 7,
                  "sketch median size is 3, 5 or 7 px, got {}", sketch.median_size);
  TARSIER_REQUIRE(
      sketch.laplacian_size % 2 == 1 && sketch.laplacian_size >= 1 && sketch.laplacian_size <= 7,
      "Laplacian aperture is 1, 3, 5 or 7, got {}", sketch.laplacian_size);
  TARSIER_REQUIRE(is_byte(sketch.threshold), "sketch threshold is 0..255, got {}",
                  sketch.threshold);
  TARSIER_REQUIRE(paint.rounds >= 0 && paint.rounds <= 50, "painting rounds are 0..50, got {}",
                  paint.rounds);
  TARSIER_REQUIRE(paint.diameter % 2 == 1 && paint.diameter >= 3 && paint.diameter <= 15,
                  "painting diameter is odd, 3..15 px, got {}", paint.diameter);
  TARSIER_REQUIRE(paint.sigma_color > 0 && paint.sigma_color <= 255,
                  "painting colour sigma is in (0, 255], got {}", paint.sigma_color);
  TARSIER_REQUIRE(paint.sigma_space > 0 && paint.sigma_space <= 100,
                  "painting space sigma is in (0, 100] px, got {}", paint.sigma_space);
  TARSIER_REQUIRE(is_byte(evil.threshold), "evil threshold is 0..255, got {}", evil.threshold);
  TARSIER_REQUIRE(evil.median_size % 2 == 1 && evil.median_size >= 1 && evil.median_size <= 7,
                  "evil median size is 1, 3, 5 or 7 px, got {}", evil.median_size);
  for (int c = 0; c < 3; ++c) {
    TARSIER_REQUIRE(skin.color[c] >= 0 && skin.color[c] <= 255, "skin colour is 0..255, got {}",
                    skin.color[c]);
    const auto i = static_cast<size_t>(c);
    TARSIER_REQUIRE(is_byte(skin.lower.at(i)) && is_byte(skin.upper.at(i)),
                    "skin differences are 0..255, got -{} +{}", skin.lower.at(i), skin.upper.at(i));
  }
  TARSIER_REQUIRE(is_byte(skin.edge_threshold), "skin edge threshold is 0..255, got {}",
                  skin.edge_threshold);
  TARSIER_REQUIRE(skin.learned_distance > 0 && skin.learned_distance <= 10,
                  "learned skin distance is in (0, 10], got {}", skin.learned_distance);
  TARSIER_REQUIRE(steady.hysteresis >= 0 && steady.hysteresis <= 0.9,
                  "steady hysteresis is 0..0.9, got {}", steady.hysteresis);
  TARSIER_REQUIRE(steady.motion >= 1 && steady.motion <= 255, "steady motion is 1..255, got {}",
                  steady.motion);
  TARSIER_REQUIRE(steady.memory >= 1 && steady.memory <= 16,
                  "steady memory is 1..16 frames, got {}", steady.memory);
}

}  // namespace tarsier::cartoon
