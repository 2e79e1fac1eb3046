// SPDX-License-Identifier: MIT
#include "tarsier/synth/plate_texts.h"

#include "tarsier/core/require.h"
#include "tarsier/synth/glyphs.h"

#include <algorithm>
#include <span>
#include <string_view>

namespace tarsier::synth {
namespace {

constexpr std::string_view kConsonants = "BCDFGHJKLMNPRSTVWXYZ";

// D digit, L letter, C consonant, A either; other characters are literal.
constexpr std::string_view kEuropePatterns[] = {
    "LL DDDLL",  "LL DDDLL",  "DLD DDDD",  "DLA DDDD",  "LLL DDDD",  "L LL DDDD",
    "LL LL DDD", "LLL LL DD", "LL DD LLL", "L DDD LLL", "LL DDDD L", "LLL DDD",
    "LL DDD LL", "DDD LL DD", "LL DDDDD",  "LLL DDDDD", "L DDDDDD",  "DD LL LL",
    "LLDD LLL",  "LL DDDL",   "D LLL DDD", "LLL DDDD",  "DDDD LLL",  "LL DD DDD"};
constexpr std::string_view kUsPatterns[] = {"DLLLDDD", "LLL DDDD", "LLL DDDD", "LLL DDD", "DDD LLL",
                                            "LDD DDD", "LLDDLLL",  "DDD DDDD", "LLD LDL", "DDDDLL",
                                            "LLDDDDD", "DLD DDDD", "LLL LDD",  "DDLLDDD"};

char symbol_of(char place, Rng& rng) {
  const auto pick = [&](std::string_view from) {
    return from[static_cast<std::size_t>(rng.integer(0, static_cast<int>(from.size()) - 1))];
  };
  switch (place) {
    case 'D':
      return pick(kPlateSymbols.substr(0, 10));
    case 'L':
      return pick(kPlateSymbols.substr(10));
    case 'C':
      return pick(kConsonants);
    case 'A':
      return pick(kPlateSymbols);
    default:
      return place;
  }
}

std::string fill(std::string_view pattern, Rng& rng) {
  std::string text;
  for (const char place : pattern) text += symbol_of(place, rng);
  return text;
}

// Groups of arbitrary symbols, so that a reader does not learn a grammar.
std::string random_groups(int least, int most, Rng& rng) {
  std::string text;
  const int length = rng.integer(least, most);
  const int gap = rng.integer(1, length - 1);
  const int second = rng.uniform() < 0.25 ? rng.integer(1, length - 1) : gap;
  for (int i = 0; i < length; ++i) {
    if (i == gap || i == second) text += ' ';
    text += symbol_of(rng.uniform() < 0.45 ? 'D' : 'L', rng);
  }
  return text;
}

std::string pick_pattern(std::span<const std::string_view> patterns, Rng& rng) {
  return fill(
      patterns[static_cast<std::size_t>(rng.integer(0, static_cast<int>(patterns.size()) - 1))],
      rng);
}

std::string random_text(PlateKind kind, bool any_text, Rng& rng) {
  const bool free = rng.uniform() < 0.35 && any_text;
  switch (kind) {
    case PlateKind::kSpain:
      return rng.uniform() < 0.2 && any_text ? random_groups(6, 7, rng) : fill("DDDD CCC", rng);
    case PlateKind::kSpainOld:
      return rng.uniform() < 0.7 ? fill(rng.uniform() < 0.5 ? "L DDDD LL" : "LL DDDD L", rng)
                                 : fill("L DDDDDD", rng);
    case PlateKind::kSpainSquare:
    case PlateKind::kSpainMoto:
      return free ? fill(rng.uniform() < 0.5 ? "LL|DDDD" : "AAA|AAA", rng) : fill("DDDD|CCC", rng);
    case PlateKind::kEurope:
      return free ? random_groups(4, 9, rng) : pick_pattern(kEuropePatterns, rng);
    case PlateKind::kUs:
      return free ? random_groups(5, 8, rng) : pick_pattern(kUsPatterns, rng);
    case PlateKind::kBrazil:
      return free ? random_groups(6, 7, rng)
                  : fill(rng.uniform() < 0.5 ? "LLL DDDD" : "LLL DLDD", rng);
  }
  return fill("DDDD CCC", rng);
}

// Adds the group gap if the user gave none.
std::string grouped(PlateKind kind, const std::string& text) {
  if (text.find_first_of(" |") != std::string::npos) return text;
  if (kind == PlateKind::kSpain && text.size() == 7)
    return text.substr(0, 4) + " " + text.substr(4);
  if ((kind == PlateKind::kSpainSquare || kind == PlateKind::kSpainMoto) && text.size() > 3)
    return text.substr(0, 4) + "|" + text.substr(4);
  if (kind == PlateKind::kBrazil && text.size() == 7)
    return text.substr(0, 3) + " " + text.substr(3);
  return text;
}

}  // namespace

std::vector<std::string> plate_text(PlateKind kind, const std::string& text, bool any_text,
                                    Rng& rng) {
  const std::string whole = text.empty() ? random_text(kind, any_text, rng) : grouped(kind, text);
  std::vector<std::string> rows(1);
  for (const char c : whole) {
    if (c == '|') {
      rows.emplace_back();
      continue;
    }
    TARSIER_REQUIRE(c == ' ' || kPlateSymbols.find(c) != std::string_view::npos,
                    "'{}' is on no plate", c);
    rows.back() += c;
  }
  for (const std::string& row : rows)
    TARSIER_REQUIRE(row.find_first_not_of(' ') != std::string::npos, "a row of '{}' is empty",
                    whole);
  TARSIER_REQUIRE(rows.size() <= 2 && whole.size() <= 24, "'{}' does not fit on a plate", whole);
  return rows;
}

}  // namespace tarsier::synth
