// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>

// Distances between plate texts.
namespace tarsier::plate {

// Minimum number of insertions, deletions and substitutions between two texts (Levenshtein, Soviet
// Physics Doklady 1966).
[[nodiscard]] int edit_distance(std::string_view a, std::string_view b);

// The same, but a '-' in `truth` is a character hidden in the image: it matches any one character
// or none.
[[nodiscard]] int edit_distance_to_truth(std::string_view truth, std::string_view text);

// Returns the letters and digits of `text` in upper case, and '-' if `keep_dash`. Other characters
// are removed.
[[nodiscard]] std::string plate_symbols(std::string_view text, bool keep_dash = false);

// Merges characters that only the country's rules distinguish: O, Q and D become 0, I becomes 1.
[[nodiscard]] std::string fold_symbols(std::string_view text);

}  // namespace tarsier::plate
