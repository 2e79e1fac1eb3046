// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>

namespace tarsier {

// The extension of a path's file name in lower case: ".jpg" for "a.b/IMG_1.JPG". It is empty where
// there is none, as in ".hidden". Only A..Z are changed, whatever the locale.
[[nodiscard]] std::string lowercase_extension(std::string_view path);

}  // namespace tarsier
