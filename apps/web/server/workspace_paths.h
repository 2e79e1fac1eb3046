// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

// Helpers of the files of class Workspace. Links are never followed.
namespace tarsier::web {

// Throws HttpError 400 for a name that is_good_name() refuses; `what` is "set", "file" ..
void check_name(std::string_view what, const std::string& name);
// Special folders of the workspace, which are not state of verbs.
[[nodiscard]] bool is_folder_name(std::string_view name);
[[nodiscard]] bool is_link(const std::string& path);
[[nodiscard]] bool is_folder(const std::string& path);
[[nodiscard]] bool is_file(const std::string& path);  // a regular one
// The first bytes, at most `max_bytes`; empty if the file cannot be read.
[[nodiscard]] std::string head_of(const std::string& path, std::size_t max_bytes);
[[nodiscard]] std::span<const std::uint8_t> bytes_of(std::string_view text);
// By the extension of its name and its first bytes.
[[nodiscard]] bool is_video(std::string_view name, std::string_view head);

}  // namespace tarsier::web
