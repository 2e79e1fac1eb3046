// SPDX-License-Identifier: MIT
#pragma once

#include <string>
#include <string_view>

namespace tarsier {

// `text` as it is written in HTML, XML and SVG, between tags or in quoted attributes: & < > " ' as
// entities; control characters but tab and line ends, which XML cannot hold, are left out.
[[nodiscard]] std::string escaped_markup(std::string_view text);

}  // namespace tarsier
