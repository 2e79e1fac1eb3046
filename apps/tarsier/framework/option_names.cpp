// SPDX-License-Identifier: MIT
#include "option_names.h"

#include <algorithm>

namespace tarsier::cli {

std::string with_flag_names(std::string_view message, const std::vector<std::string>& flags) {
  constexpr std::string_view kBefore = "option '";
  std::string result;
  while (true) {
    const std::size_t begin = message.find(kBefore);
    const std::size_t name = begin + kBefore.size();
    const std::size_t end = begin == std::string_view::npos ? begin : message.find('\'', name);
    if (end == std::string_view::npos) return result.append(message);
    std::string flag = "--" + std::string(message.substr(name, end - name));
    std::replace(flag.begin(), flag.end(), '_', '-');
    if (std::find(flags.begin(), flags.end(), flag) != flags.end()) {
      result.append(message.substr(0, begin)).append(flag);
      message.remove_prefix(end + 1);
    } else {
      result.append(message.substr(0, name));
      message.remove_prefix(name);
    }
  }
}

}  // namespace tarsier::cli
