// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

// Patterns of plate texts: '*' stands for any characters, '?' for one. Texts are found through an
// index of trigrams ("pieces") of the folded text with an end mark: '1234BCD' has 123, 234, 34B,
// 4BC, BC0, C0$.
namespace tarsier::plate {

inline constexpr std::size_t kGramSize = 3;  // characters per piece
// Maximum characters of a pattern, of a correction, and of the indexed text.
inline constexpr std::size_t kMaxText = 64;

// Parses a pattern typed by a user ("b-12?4*"), for LogFilter::text. Throws UsageError, which names
// `what`, for characters that no plate can have.
[[nodiscard]] std::string plate_pattern(std::string_view text, std::string_view what = "text");

// Returns whether a text matches a pattern. With `near`, both are folded (fold_symbols() of text.h:
// O, Q and D become 0, I becomes 1, ..), and one character may be wrong, missing or extra.
[[nodiscard]] bool matches(std::string_view pattern, std::string_view text, bool near);

// The pieces of the first 64 characters of a text, sorted, without duplicates.
[[nodiscard]] std::vector<std::string> trigrams_of(const std::string& text);

// Pieces that every matching text contains, longest first. They do not overlap. They have kGramSize
// characters where possible; a shorter one is the beginning of a piece.
[[nodiscard]] std::vector<std::string> required_pieces(const std::string& pattern);

// Two pieces. A text within one edit contains at least one of them, because one edit can change
// only one. Empty if the pattern is too short.
[[nodiscard]] std::vector<std::string> near_match_pieces(const std::string& pattern);

}  // namespace tarsier::plate
