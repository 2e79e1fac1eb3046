// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>

namespace tarsier {

// Escapes `text` for HTML, XML and SVG, between tags or in quoted attributes: & < > " ' become
// entities. Control characters that XML cannot contain (all but tab and line ends) are dropped.
[[nodiscard]] std::string escaped_markup(std::string_view text);

}  // namespace tarsier
