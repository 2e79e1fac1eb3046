// SPDX-License-Identifier: MIT
#include "option_names.h"

#include <algorithm>
#include <optional>

namespace tarsier::cli {

namespace {

std::optional<std::string> flag_of(std::string_view field, const std::vector<std::string>& flags) {
  std::string flag = "--" + std::string(field);
  std::replace(flag.begin(), flag.end(), '_', '-');
  const auto is_known = [&] { return std::find(flags.begin(), flags.end(), flag) != flags.end(); };
  if (is_known()) return flag;
  for (const std::string_view unit : {"-s", "-px", "-mm", "-gb", "-deg"}) {
    if (!flag.ends_with(unit)) continue;
    flag.resize(flag.size() - unit.size());
    if (is_known()) return flag;
    break;
  }
  return std::nullopt;
}

}  // namespace

std::string with_flag_names(std::string_view message, const std::vector<std::string>& flags) {
  constexpr std::string_view kBefore = "option '";
  std::string result;
  while (true) {
    const std::size_t begin = message.find(kBefore);
    const std::size_t name = begin + kBefore.size();
    const std::size_t end = begin == std::string_view::npos ? begin : message.find('\'', name);
    if (end == std::string_view::npos) return result.append(message);
    const std::optional<std::string> flag = flag_of(message.substr(name, end - name), flags);
    if (flag) {
      result.append(message.substr(0, begin)).append(*flag);
      message.remove_prefix(end + 1);
    } else {
      result.append(message.substr(0, name));
      message.remove_prefix(name);
    }
  }
}

}  // namespace tarsier::cli
