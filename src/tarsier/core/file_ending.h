// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>

namespace tarsier {

// The ending of a path's file name in small letters: ".jpg" of "a.b/IMG_1.JPG"; empty where it has
// none, as of ".hidden". Only A..Z change, whatever the locale.
[[nodiscard]] std::string lower_ending(std::string_view path);

}  // namespace tarsier
