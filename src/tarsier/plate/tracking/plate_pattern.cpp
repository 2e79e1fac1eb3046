// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/plate_pattern.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/plate/text/reading.h"
#include "tarsier/plate/text/text.h"

#include <fmt/format.h>

#include <algorithm>

namespace tarsier::plate {
namespace {

// Edit distance of a pattern and a text, with free edits for '*' and '?'. Values above one are
// reported as two.
int pattern_edits(std::string_view pattern, std::string_view text) {
  std::vector<int> row(text.size() + 1);
  for (std::size_t j = 0; j < row.size(); ++j) row[j] = static_cast<int>(j);
  for (const char c : pattern) {
    int diagonal = row[0];
    row[0] += c == '*' ? 0 : 1;
    for (std::size_t j = 1; j < row.size(); ++j) {
      const int above = row[j];
      if (c == '*') {
        row[j] = std::min(above, row[j - 1]);
      } else {
        const bool same = c == '?' || c == text[j - 1];
        row[j] = std::min({diagonal + (same ? 0 : 1), above + 1, row[j - 1] + 1});
      }
      diagonal = above;
    }
  }
  return row.back();
}

// Exact match: after a mismatch, continues from the latest '*'.
bool matches_exactly(std::string_view pattern, std::string_view text) {
  std::size_t p = 0;
  std::size_t t = 0;
  std::size_t star = std::string_view::npos;
  std::size_t resume = 0;
  while (t < text.size()) {
    if (p < pattern.size() && pattern[p] == '*') {
      star = p++;
      resume = t;
    } else if (p < pattern.size() && (pattern[p] == '?' || pattern[p] == text[t])) {
      ++p;
      ++t;
    } else if (star != std::string_view::npos) {
      p = star + 1;
      t = ++resume;
    } else {
      return false;
    }
  }
  while (p < pattern.size() && pattern[p] == '*') ++p;
  return p == pattern.size();
}

// The literal parts of a folded pattern; a part at the pattern's end ends in '$'.
std::vector<std::string> literals_of(const std::string& pattern) {
  std::vector<std::string> parts(1);
  for (const char c : fold_symbols(pattern) + '$') {
    if (c != '*' && c != '?') {
      parts.back() += c;
    } else if (!parts.back().empty()) {
      parts.emplace_back();
    }
  }
  std::erase_if(parts, [](const std::string& part) { return part.empty() || part == "$"; });
  return parts;
}

// Two characters at the end of a text, with the end mark, are not the beginning of a gram.
bool is_indexed_piece(std::string_view piece) {
  return piece.size() >= kGramSize || (piece.size() == 2 && piece.back() != '$');
}

}  // namespace

std::string plate_pattern(std::string_view text, std::string_view what) {
  std::string pattern;
  for (const char c : text) {
    if (c == ' ' || c == '-') continue;
    const char upper = c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
    if (class_of(upper) < 0 && upper != '*' && upper != '?') {
      throw UsageError(
          fmt::format("{} '{}': letters, digits, '*' (any characters) and '?' (any "
                      "one) are expected",
                      what, printable(text)));
    }
    pattern += upper;
  }
  if (pattern.empty() || pattern.size() > kMaxText) {
    throw UsageError(
        fmt::format("{} '{}': one to 64 characters are expected", what, printable(text)));
  }
  return pattern;
}

bool matches(std::string_view pattern, std::string_view text, bool near) {
  if (!near) return matches_exactly(pattern, text);
  return pattern_edits(fold_symbols(pattern), fold_symbols(text)) <= 1;
}

std::vector<std::string> trigrams_of(const std::string& text) {
  const std::string folded = fold_symbols(std::string_view(text).substr(0, kMaxText)) + '$';
  std::vector<std::string> grams;
  for (std::size_t k = 0; k == 0 || k + kGramSize <= folded.size(); ++k)
    grams.push_back(folded.substr(k, kGramSize));
  std::sort(grams.begin(), grams.end());
  grams.erase(std::unique(grams.begin(), grams.end()), grams.end());
  return grams;
}

std::vector<std::string> required_pieces(const std::string& pattern) {
  std::vector<std::string> pieces;
  for (const std::string& part : literals_of(pattern)) {
    std::size_t at = 0;
    for (; at + kGramSize <= part.size(); at += kGramSize)
      pieces.push_back(part.substr(at, kGramSize));
    if (is_indexed_piece(part.substr(at))) pieces.push_back(part.substr(at));
  }
  std::stable_sort(pieces.begin(), pieces.end(),
                   [](const std::string& a, const std::string& b) { return a.size() > b.size(); });
  return pieces;
}

std::vector<std::string> near_match_pieces(const std::string& pattern) {
  std::vector<std::string> pieces = required_pieces(pattern);
  if (pieces.size() >= 2) return {pieces[0], pieces[1]};
  for (const std::string& part : literals_of(pattern)) {
    if (part.size() < 4) continue;
    const std::string first = part.substr(0, 2);
    const std::string second = part.substr(2, kGramSize);
    if (is_indexed_piece(second)) return {first, second};
  }
  return {};
}

}  // namespace tarsier::plate
