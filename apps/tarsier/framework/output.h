// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

namespace tarsier::cli {

// Writes text for people to stdout and flushes. Throws OutputError if stdout is closed or full.
void print_text(std::string_view text);

// Writes one JSON object as a line to stdout and flushes. Throws as print_text() does.
void print_json(const nlohmann::ordered_json& object);

// The object as one line without its end. Bytes that are not UTF-8 (possible in file names) are
// replaced, so that it can always be printed.
[[nodiscard]] std::string json_text(const nlohmann::ordered_json& object);

// `value` rounded to `digits` decimal digits, 0..9, for JSON lines; infinity and NaN are unchanged.
[[nodiscard]] double rounded(double value, int digits);

}  // namespace tarsier::cli
