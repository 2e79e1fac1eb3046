// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <string_view>

namespace tarsier::face::people {

inline constexpr std::size_t kMaxNameBytes = 200;

// A person's name is any UTF-8 of 1 to 200 bytes without control characters that does not begin or
// end with a space. Quotes and slashes are allowed. Throws UsageError that says what is wrong.
void check_name(std::string_view name);

// A note is UTF-8 of up to 10 000 bytes. Throws UsageError.
void check_note(std::string_view note);

[[nodiscard]] bool is_utf8(std::string_view text);

}  // namespace tarsier::face::people
