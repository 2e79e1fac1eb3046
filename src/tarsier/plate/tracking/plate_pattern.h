// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

// Patterns of plates' texts: '*' stands for any characters, '?' for one. Texts are found through an
// index of their pieces ("grams"): of each folded text and an end mark ('1234BCD' has 123, 234, 34B,
// 4BC, BC0, C0$).
namespace tarsier::plate {

inline constexpr std::size_t kGram = 3;  // characters of a piece
inline constexpr std::size_t kMaxText =
    64;  // characters of a pattern, of a correction, and of what pieces are made of

// A pattern as people type it ("b-12?4*"), for LogFilter::text. Throws UsageError naming `what`
// for what no plate can hold.
[[nodiscard]] std::string plate_pattern(std::string_view text, std::string_view what = "text");

// Whether a text matches a pattern. `near`: both are folded (fold_symbols() of text.h: O, Q and D
// are 0, I is 1, ..), and one character may be wrong, missing or too many.
[[nodiscard]] bool matches(std::string_view pattern, std::string_view text, bool near);

// The pieces of a text, each once, sorted. Of the first 64 characters.
[[nodiscard]] std::vector<std::string> grams_of(const std::string& text);

// Pieces that every text that matches must hold: they do not overlap and are of kGram characters
// where there are such, the longer first. A shorter one is the beginning of a piece.
[[nodiscard]] std::vector<std::string> pieces_of(const std::string& pattern);

// Two pieces of which a text that is near holds at least one: one edit spoils one of them. Empty
// where the pattern is too short.
[[nodiscard]] std::vector<std::string> halves_of(const std::string& pattern);

}  // namespace tarsier::plate
