// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

// Tables of text as in RFC 4180, one record per line: fields contain no line breaks.
namespace tarsier {

// The fields of one line (without its line end). nullopt where a quote is not closed or is in the
// middle of a field.
[[nodiscard]] std::optional<std::vector<std::string>> csv_fields(std::string_view line);

// Encodes one field. A text with commas, quotes or control characters is quoted, and its line
// breaks become spaces. A text that a spreadsheet would take for a formula (it begins with = + - @
// and is not a number) gets a leading apostrophe.
[[nodiscard]] std::string csv_field(std::string_view text);

// Encodes one line, with its line end.
[[nodiscard]] std::string csv_line(const std::vector<std::string>& fields);

}  // namespace tarsier
