// SPDX-License-Identifier: MIT
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

// Declares the allowed values of an algorithm's options in one place. A struct of options lists its
// fields:
//
//   struct MatchOptions {
//     // Distance of the best match divided by that of the second best, at most.
//     double ratio = 0.8;
//
//     [[nodiscard]] OptionFields fields() {
//       return {{"ratio", ratio, range(0.1, 1), "--ratio", "maximum distance ratio"}};
//     }
//     void check() const { check_fields(*this); }
//   };
//
// check(), the flags of the program (apps/tarsier/framework/bind.h), their help, the manual pages
// and `tarsier help --json` are generated from this list. Rules between fields belong into check().

namespace tarsier {

// The numbers that a field may have. Infinity and NaN are never allowed.
struct Range {
  double min = -std::numeric_limits<double>::infinity();
  double max = std::numeric_limits<double>::infinity();
  // Whether `min` or `max` itself is excluded.
  bool above_min = false;
  bool below_max = false;
  // Only odd numbers are allowed.
  bool odd = false;

  [[nodiscard]] bool contains(double value) const;
  // "0..1", "> 0", ">= 0", "> 0, <= 255", "3..7, odd"; empty if every number is allowed.
  [[nodiscard]] std::string text() const;
};

// min <= value <= max
constexpr Range range(double min, double max) { return {min, max}; }
// min <= value <= max, and odd
constexpr Range odd_range(double min, double max) { return {min, max, false, false, true}; }
// min <= value < max
constexpr Range range_below(double min, double max) { return {min, max, false, true}; }
// min < value < max
constexpr Range inside(double min, double max) { return {min, max, true, true}; }
// min < value <= max
constexpr Range above(double min, double max = std::numeric_limits<double>::infinity()) {
  return {min, max, true};
}
// min <= value
constexpr Range at_least(double min) { return {min}; }

// A field of a struct of options. For a list, each value must be in `range`.
struct OptionField {
  using Value = std::variant<bool*, int*, unsigned*, std::int64_t*, std::uint64_t*, float*, double*,
                             std::string*, std::optional<int>*, std::optional<double>*,
                             std::vector<int>*, std::vector<double>*>;

  // A number. A field without flag and help is not available on the command line.
  template <class T>
  OptionField(std::string_view its_name, T& its_value, const Range& its_range,
              std::string_view its_flag = {}, std::string_view its_help = {})
      : name(its_name), value(&its_value), range(its_range), flag(its_flag), help(its_help) {}
  // A switch, a text, or a number without a range.
  template <class T>
  OptionField(std::string_view its_name, T& its_value, std::string_view its_flag,
              std::string_view its_help)
      : OptionField(its_name, its_value, Range{}, its_flag, its_help) {}

  std::string_view name;
  Value value;
  Range range = {};
  // "--ratio"; empty if the field has no flag.
  std::string_view flag;
  // Begins with the unit, if the number has one: "px, of the shortest side".
  std::string_view help;
};
using OptionFields = std::vector<OptionField>;

// The unit that a help text begins with: "px", "degrees", "s"; empty if there is none.
[[nodiscard]] std::string_view unit_of(std::string_view help);

// Throws std::invalid_argument for the first value outside its range: "ratio 2: expected 0.1..1".
void check_fields(const OptionFields& fields);

// Checks a struct that has `fields()`.
template <class Options>
void check_fields(const Options& options) {
  check_fields(const_cast<Options&>(options).fields());  // the fields are only read
}

}  // namespace tarsier
