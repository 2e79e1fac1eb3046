// SPDX-License-Identifier: MIT
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>

// Removes the names of forgotten people from what jobs have stored.
namespace tarsier::web {

inline constexpr std::string_view kForgotten = "(forgotten)";

// Replaces `name` by kForgotten where it is not a part of a longer word.
[[nodiscard]] std::string without_name(std::string text, std::string_view name);
// The same in all strings of `value`, but not in the names of its members.
void remove_name(nlohmann::json& value, std::string_view name);
// The same in a line, which may be JSON.
[[nodiscard]] std::string line_without_name(const std::string& line, std::string_view name);
// The same in all lines of a file; a file with zero bytes is no text and is left unchanged. Throws
// OutputError.
void remove_name_from_file(const std::string& path, std::string_view name);

}  // namespace tarsier::web
