// SPDX-License-Identifier: MIT
#include "tarsier/core/markup.h"

namespace tarsier {

std::string escaped_markup(std::string_view text) {
  std::string result;
  result.reserve(text.size());
  for (const char c : text) {
    switch (c) {
      case '&':
        result += "&amp;";
        break;
      case '<':
        result += "&lt;";
        break;
      case '>':
        result += "&gt;";
        break;
      case '"':
        result += "&quot;";
        break;
      case '\'':
        result += "&#39;";
        break;
      case '\t':
      case '\n':
      case '\r':
        result += c;
        break;
      default:
        if (static_cast<unsigned char>(c) >= 32) result += c;
    }
  }
  return result;
}

}  // namespace tarsier
