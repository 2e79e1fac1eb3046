// SPDX-License-Identifier: MIT
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

// Tables of text as in RFC 4180, a record a line: no line breaks within fields.
namespace tarsier {

// The fields of one line (without its end), or nothing where a quote is not closed or stands in the
// middle of a field.
[[nodiscard]] std::optional<std::vector<std::string>> csv_fields(std::string_view line);

// One field of a line. A text with commas, quotes or control characters is quoted; line breaks in it
// become spaces. A text that a spreadsheet would take for a formula (beginning with = + - @ and no
// number) gets a leading apostrophe.
[[nodiscard]] std::string csv_field(std::string_view text);

// One line of such fields, with its end.
[[nodiscard]] std::string csv_line(const std::vector<std::string>& fields);

}  // namespace tarsier
