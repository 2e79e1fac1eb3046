// SPDX-License-Identifier: MIT
#include "bind.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

namespace tarsier::cli {
namespace {

template <class T>
constexpr bool is_list = false;
template <class T>
constexpr bool is_list<std::vector<T>> = true;

}  // namespace

Flag& add_field(Command& verb, const OptionField& field) {
  if (field.flag.empty()) throw std::invalid_argument(std::string(field.name) + " has no flag");
  return std::visit(
      [&](auto* value) -> Flag& {
        if constexpr (std::is_same_v<decltype(value), bool*>) {
          return verb.add_flag(field.flag, *value, field.help);
        } else {
          Flag& flag = verb.add_option(field.flag, *value, field.help).show_default();
          if constexpr (is_list<std::remove_pointer_t<decltype(value)>>) flag.delimiter(',');
          return field.range.text().empty() ? flag : flag.check(field.range);
        }
      },
      field.value);
}

void add_fields(Command& verb, const OptionFields& fields, std::string_view group) {
  for (const OptionField& field : fields) {
    if (!field.flag.empty()) add_field(verb, field).group(group);
  }
}

const OptionField& field_of(const OptionFields& fields, const void* value) {
  const auto holds = [value](const OptionField& field) {
    return std::visit([value](const auto* own) { return static_cast<const void*>(own) == value; },
                      field.value);
  };
  const auto found = std::find_if(fields.begin(), fields.end(), holds);
  if (found == fields.end()) throw std::invalid_argument("this is not a field of the options");
  return *found;
}

}  // namespace tarsier::cli
