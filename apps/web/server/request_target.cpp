// SPDX-License-Identifier: MIT
#include "request_target.h"

#include "tarsier/core/words.h"

#include "router.h"
#include <algorithm>

namespace tarsier::web {

std::optional<Target> parse_target(std::string_view text) {
  if (!text.starts_with('/') || text.size() > 8192) return std::nullopt;
  Target target;
  const std::size_t question = text.find('?');
  if (question != std::string_view::npos) target.query = text.substr(question + 1);
  std::string_view rest =
      text.substr(1, question == std::string_view::npos ? question : question - 1);
  if (rest.empty()) {
    target.path += '/';
    return target;
  }
  while (true) {
    const std::size_t slash = rest.find('/');
    const auto segment = percent_decoded(rest.substr(0, slash), false);
    if (!segment || segment->empty() || *segment == "." || *segment == "..") return std::nullopt;
    for (const char c : *segment) {
      if (c == '/' || c == '\\' || static_cast<unsigned char>(c) < 0x20 || c == 0x7f)
        return std::nullopt;
    }
    target.path += '/';
    target.path += *segment;
    if (slash == std::string_view::npos) return target;
    rest.remove_prefix(slash + 1);
  }
}

std::optional<ByteRange> parse_range(std::string_view text, std::uint64_t size,
                                     bool& unsatisfiable) {
  unsatisfiable = false;
  constexpr std::string_view kUnit = "bytes=";
  constexpr std::int64_t kMaxOffset = std::int64_t{1} << 60;
  if (!text.starts_with(kUnit)) return std::nullopt;
  text.remove_prefix(kUnit.size());
  const std::size_t dash = text.find('-');
  if (dash == std::string_view::npos) return std::nullopt;
  const std::string_view first = trimmed(text.substr(0, dash));
  const std::string_view last = trimmed(text.substr(dash + 1));
  const auto number = [&](std::string_view digits) -> std::optional<std::uint64_t> {
    if (digits.empty() || digits.find_first_not_of("0123456789") != std::string_view::npos)
      return std::nullopt;
    const auto value = to_integer(digits, 0, kMaxOffset);
    return value ? std::optional<std::uint64_t>(static_cast<std::uint64_t>(*value)) : std::nullopt;
  };
  ByteRange range;
  if (first.empty()) {
    const auto count = number(last);
    if (!count) return std::nullopt;
    unsatisfiable = *count == 0 || size == 0;
    range.first = size - std::min(size, *count);
    range.last = size - 1;
  } else {
    const auto begin = number(first);
    const auto end = last.empty() ? std::optional<std::uint64_t>(size - 1) : number(last);
    if (!begin || !end || (!last.empty() && *end < *begin)) return std::nullopt;
    unsatisfiable = *begin >= size;
    range.first = *begin;
    range.last = std::min(*end, size - 1);
  }
  if (unsatisfiable) return std::nullopt;
  return range;
}

}  // namespace tarsier::web
