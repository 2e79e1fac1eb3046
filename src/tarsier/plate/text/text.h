// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>

// Distances between plate texts.
namespace tarsier::plate {

// How many characters must be replaced, put in or left out to turn one text into the other
// (Levenshtein, Soviet Physics Doklady 1966).
[[nodiscard]] int edit_distance(std::string_view a, std::string_view b);

// The same where '-' in `truth` is a character that is hidden in the image: it matches any one
// character or none.
[[nodiscard]] int edit_distance_to_truth(std::string_view truth, std::string_view text);

// Upper case letters and digits of `text`, in upper case, and '-' where `keep_dash`; the rest is
// left out.
[[nodiscard]] std::string plate_symbols(std::string_view text, bool keep_dash = false);

// Characters that only the country's rules distinguish are made one: O, Q and D become 0, I
// becomes 1.
[[nodiscard]] std::string fold_symbols(std::string_view text);

}  // namespace tarsier::plate
