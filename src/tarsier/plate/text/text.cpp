// SPDX-License-Identifier: MIT
#include "tarsier/plate/text/text.h"

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <vector>

namespace tarsier::plate {
namespace {

// Wagner and Fischer, J. ACM 1974, with one row of the table. hidden: '\0' means none.
int distance(std::string_view a, std::string_view b, char hidden) {
  std::vector<int> row(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (const char c : a) {
    const bool free = hidden != '\0' && c == hidden;
    int diagonal = row[0];
    row[0] += free ? 0 : 1;
    for (std::size_t j = 1; j < row.size(); ++j) {
      const int left_out = row[j] + (free ? 0 : 1);
      const int replaced = diagonal + (free || c == b[j - 1] ? 0 : 1);
      diagonal = row[j];
      row[j] = std::min({left_out, row[j - 1] + 1, replaced});
    }
  }
  return row.back();
}

}  // namespace

int edit_distance(std::string_view a, std::string_view b) { return distance(a, b, '\0'); }

int edit_distance_to_truth(std::string_view truth, std::string_view text) {
  return distance(truth, text, '-');
}

std::string plate_symbols(std::string_view text, bool keep_dash) {
  std::string symbols;
  for (char c : text) {
    if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 'a' + 'A');
    if ((c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || (keep_dash && c == '-')) symbols += c;
  }
  return symbols;
}

std::string fold_symbols(std::string_view text) {
  std::string folded(text);
  for (char& c : folded) {
    if (c == 'O' || c == 'Q' || c == 'D') c = '0';
    if (c == 'I') c = '1';
  }
  return folded;
}

}  // namespace tarsier::plate
