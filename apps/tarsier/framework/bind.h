// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include "command.h"
#include <string_view>

// Flags of the fields of options: names, ranges and help are those of Options::fields(), defaults
// the values that the options have now.
//
//   bind_all(verb, flags.matching, "Features and matches");  // every field that has a flag
//   bind_field(verb, flags.matching, flags.matching.ratio);  // one of them
//   bind_field(verb, flags.training, flags.training.line_steps, "--steps", "training steps");

namespace tarsier::cli {

// Adds the flag of one field; the values of a list may be one word, "1,2,3". Throws
// std::invalid_argument for a field without a flag.
Flag& add_field(Command& verb, const OptionField& field);

// Adds the flags of all fields that have one, under a heading in --help.
void add_fields(Command& verb, const OptionFields& fields, std::string_view group);

// The field whose value is `value`. Throws std::invalid_argument if no field has it.
[[nodiscard]] const OptionField& field_of(const OptionFields& fields, const void* value);

template <class Options>
void bind_all(Command& verb, Options& options, std::string_view group = "Options") {
  add_fields(verb, options.fields(), group);
}

// With another name and help than the field's, where they are given.
template <class Options, class Value>
Flag& bind_field(Command& verb, Options& options, const Value& value, std::string_view flag = {},
                 std::string_view help = {}) {
  const OptionFields fields = options.fields();
  OptionField field = field_of(fields, &value);
  if (!flag.empty()) field.flag = flag;
  if (!help.empty()) field.help = help;
  return add_field(verb, field);
}

}  // namespace tarsier::cli
