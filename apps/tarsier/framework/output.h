// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace tarsier::cli {

// Writes text for people to stdout and flushes. Throws OutputError when stdout is closed or full.
void print_text(std::string_view text);

// Writes one JSON object as a line to stdout and flushes. Throws like print_text.
void print_json(const nlohmann::ordered_json& object);

// The object as one line without its end. Bytes that are no UTF-8 (names of files need not be) are
// replaced: it can always be printed.
[[nodiscard]] std::string json_text(const nlohmann::ordered_json& object);

// `value` with so many decimal digits, 0..9, as a line of JSON shows it; infinity and NaN as they
// are.
[[nodiscard]] double rounded(double value, int digits);

}  // namespace tarsier::cli
