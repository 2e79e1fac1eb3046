// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

// What the files of the class Workspace share. Links are never followed.
namespace tarsier::web {

// HttpError 400 for a name that is_good_name() refuses; `what` is "set", "file" ..
void check_name(std::string_view what, const std::string& name);
// Folders of the workspace with a meaning of their own, which are no state of verbs.
[[nodiscard]] bool is_folder_name(std::string_view name);
[[nodiscard]] bool is_link(const std::string& path);
[[nodiscard]] bool is_folder(const std::string& path);
[[nodiscard]] bool is_file(const std::string& path);  // a regular one
// At most so many first bytes; empty where it cannot be read.
[[nodiscard]] std::string head_of(const std::string& path, std::size_t most);
[[nodiscard]] std::span<const std::uint8_t> bytes_of(std::string_view text);
// By the ending of its name and its first bytes.
[[nodiscard]] bool is_video(std::string_view name, std::string_view head);

}  // namespace tarsier::web
