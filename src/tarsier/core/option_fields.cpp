// SPDX-License-Identifier: MIT
#include "tarsier/core/option_fields.h"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>
#include <type_traits>

namespace tarsier {
namespace {

template <class T>
constexpr bool is_number_type = std::is_arithmetic_v<T> && !std::is_same_v<T, bool>;

// Calls `visit` with every number of the field.
template <class Visit>
void for_each_number(const OptionField& field, const Visit& visit) {
  std::visit(
      [&visit](const auto* value) {
        using T = std::remove_cvref_t<decltype(*value)>;
        if constexpr (is_number_type<T>) {
          visit(*value);
        } else if constexpr (!std::is_same_v<T, bool> && !std::is_same_v<T, std::string>) {
          if constexpr (requires { value->has_value(); }) {
            if (value->has_value()) visit(**value);
          } else {
            for (const auto number : *value) visit(number);
          }
        }
      },
      field.value);
}

}  // namespace

bool Range::contains(double value) const {
  return std::isfinite(value) && (above_min ? value > min : value >= min) &&
         (below_max ? value < max : value <= max) && (!odd || std::fmod(std::abs(value), 2) == 1);
}

std::string Range::text() const {
  const bool from = std::isfinite(min), to = std::isfinite(max);
  const char* const tail = odd ? ", odd" : "";
  if (from && to && !above_min && !below_max) return fmt::format("{}..{}{}", min, max, tail);
  std::string text;
  if (from) text = fmt::format("{} {}", above_min ? ">" : ">=", min);
  if (to) text += fmt::format("{}{} {}", from ? ", " : "", below_max ? "<" : "<=", max);
  return text + tail;
}

std::string_view unit_of(std::string_view help) {
  constexpr std::string_view kUnits[] = {"px",      "s",    "seconds",     "mm", "m",      "GB",
                                         "degrees", "nats", "grey levels", "%",  "frames", "Hz"};
  for (const std::string_view unit : kUnits) {
    if (!help.starts_with(unit)) continue;
    const std::string_view rest = help.substr(unit.size());
    if (rest.empty() || rest[0] == ' ' || rest[0] == ',' || rest[0] == ';') return unit;
  }
  return {};
}

void check_fields(const OptionFields& fields) {
  for (const OptionField& field : fields) {
    for_each_number(field, [&field](auto value) {
      if (field.range.contains(static_cast<double>(value)) || field.range.text().empty()) return;
      const std::string_view unit = unit_of(field.help);
      throw std::invalid_argument(fmt::format("{} {}: expected {}{}{}", field.name, value,
                                              field.range.text(), unit.empty() ? "" : " ", unit));
    });
  }
}

}  // namespace tarsier
