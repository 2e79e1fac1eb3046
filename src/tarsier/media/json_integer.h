// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>

namespace tarsier {

// The value of an integer JSON number, clamped to the range of T. Throws nlohmann::json::type_error
// for any other value, because nlohmann's own conversion of 1e300 to an integer is undefined.
template <class T>
[[nodiscard]] T json_integer(const nlohmann::json& value) {
  constexpr auto kLow = std::numeric_limits<T>::lowest();
  constexpr auto kHigh = std::numeric_limits<T>::max();
  if (value.is_number_unsigned()) {
    const auto number = value.get<std::uint64_t>();
    return number > static_cast<std::uint64_t>(kHigh) ? kHigh : static_cast<T>(number);
  }
  const std::int64_t number = value.get_ref<const nlohmann::json::number_integer_t&>();
  if (number < static_cast<std::int64_t>(kLow)) return kLow;
  return number > static_cast<std::int64_t>(kHigh) ? kHigh : static_cast<T>(number);
}

}  // namespace tarsier
