// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/options.h"

#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"

namespace tarsier::cartoon {
namespace {

constexpr NameTable<Mode, 8> kModes{"mode",
                                    {{{Mode::kSketch, "sketch"},
                                      {Mode::kPaint, "paint"},
                                      {Mode::kCartoon, "cartoon"},
                                      {Mode::kEvil, "evil"},
                                      {Mode::kEvilSketch, "evil-sketch"},
                                      {Mode::kAlien, "alien"},
                                      {Mode::kSmooth, "smooth"},
                                      {Mode::kNone, "none"}}}};

constexpr NameTable<Quality, 3> kQualities{
    "quality",
    {{{Quality::kReference, "reference"}, {Quality::kFast, "fast"}, {Quality::kDraft, "draft"}}}};

bool is_byte(int value) { return value >= 0 && value <= 255; }

}  // namespace

std::string_view name_of(Mode mode) { return kModes.name(mode); }
Mode parse_mode(std::string_view name) { return kModes.parse(name); }

const std::vector<Mode>& all_modes() {
  static const std::vector<Mode> modes = [] {
    std::vector<Mode> list;
    list.reserve(kModes.names.size());
    for (const auto& entry : kModes.names) list.push_back(entry.first);
    return list;
  }();
  return modes;
}

bool uses_skin(Mode mode) { return mode == Mode::kAlien || mode == Mode::kSmooth; }

std::string_view name_of(Quality quality) { return kQualities.name(quality); }
Quality parse_quality(std::string_view name) { return kQualities.parse(name); }

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
