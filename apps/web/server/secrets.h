// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>

namespace tarsier::web {

// 256 random bits as 64 hexadecimal digits (getrandom). Throws OutputError if the system has none.
[[nodiscard]] std::string new_secret();
// SHA-256 as hexadecimal digits: the stored form of a secret.
[[nodiscard]] std::string hash_of(std::string_view secret);
// Whether the text is 64 lower-case hexadecimal digits.
[[nodiscard]] bool looks_like_secret(std::string_view text);

}  // namespace tarsier::web
