// SPDX-License-Identifier: MIT
#include "tarsier/core/name_table.h"

#include "tarsier/core/log.h"

namespace tarsier {

std::string unknown_name(std::string_view what, std::string_view text,
                         const std::vector<std::string>& known) {
  std::string message = "unknown ";
  message.append(what).append(" '").append(printable(text)).append("': ");
  for (std::size_t i = 0; i < known.size(); ++i) {
    if (i > 0) message += i + 1 == known.size() ? " or " : ", ";
    message += known[i];
  }
  return message;
}

}  // namespace tarsier
