// SPDX-License-Identifier: MIT
#include "command_json.h"

#include <cmath>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

using Json = nlohmann::ordered_json;

// One value, from the text that --help shows.
Json value_of(FlagType type, const std::string& text) {
  if (type == FlagType::kSwitch) return text == "on" || text == "true";
  if (type == FlagType::kText) return text;
  const Json number = Json::parse(text, nullptr, false);
  return number.is_number() ? number : Json(text);
}

Json default_of(const FlagInfo& flag) {
  const std::string& text = flag.default_value;
  if (flag.type == FlagType::kSwitch) return value_of(flag.type, text);
  if (text.empty()) return nullptr;
  const bool several = flag.many || flag.min_values > 1;
  if (!several) return value_of(flag.type, text);
  Json values = Json::array();
  const bool brackets = text.front() == '[' && text.back() == ']';
  const std::string list = brackets ? text.substr(1, text.size() - 2) : text;
  for (std::size_t from = 0; from < list.size();) {
    const std::size_t end = std::min(list.find(',', from), list.size());
    values.push_back(value_of(flag.type, list.substr(from, end - from)));
    from = end + 1;
  }
  return values;
}

Json number_or_null(double number) {
  if (!std::isfinite(number)) return nullptr;
  const auto whole = static_cast<std::int64_t>(number);
  return static_cast<double>(whole) == number ? Json(whole) : Json(number);
}

Json range_of(const std::optional<Range>& range) {
  if (!range) return nullptr;
  return {{"min", number_or_null(range->min)},
          {"max", number_or_null(range->max)},
          {"min_excluded", range->above_min},
          {"max_excluded", range->below_max},
          {"odd", range->odd}};
}

Json unit_or_null(const FlagInfo& flag) {
  const bool number = flag.type == FlagType::kInteger || flag.type == FlagType::kNumber;
  const std::string_view unit = number ? unit_of(flag.description) : std::string_view();
  return unit.empty() ? Json(nullptr) : Json(unit);
}

Json flag_json(const FlagInfo& flag) {
  return {
      {"names", flag.names},
      {"positional", flag.positional || flag.positional_name.empty() ? Json(nullptr)
                                                                     : Json(flag.positional_name)},
      {"type", name_of(flag.type)},
      {"choices", flag.choices},
      {"suggestions", flag.suggestions},
      {"range", range_of(flag.range)},
      {"unit", unit_or_null(flag)},
      {"default", default_of(flag)},
      {"headless_value", flag.headless_value.empty() ? Json(nullptr) : Json(flag.headless_value)},
      {"values", flag.min_values},
      {"repeatable", flag.many},
      {"required", flag.required},
      {"help", flag.description},
      {"group", flag.group},
      {"needs", flag.needs},
      {"excludes", flag.excludes}};
}

Json verb_json(const AreaInfo& area, const VerbInfo& verb) {
  std::string words;
  for (const std::string& word : verb.path) words += (words.empty() ? "" : " ") + word;
  Json inputs = Json::array(), flags = Json::array();
  for (const FlagInfo& flag : verb.flags) {
    (flag.positional ? inputs : flags).push_back(flag_json(flag));
  }
  return {{"verb", words},
          {"path", verb.path},
          {"area", area.name},
          {"help", verb.description},
          {"usage", verb.usage},
          {"example", verb.example},
          {"inputs", std::move(inputs)},
          {"flags", std::move(flags)}};
}

}  // namespace

std::string command_json(const std::vector<AreaInfo>& areas, std::string_view version) {
  Json verbs = Json::array();
  for (const AreaInfo& area : areas) {
    for (const VerbInfo& verb : area.verbs) verbs.push_back(verb_json(area, verb));
  }
  return Json{{"program", "tarsier"}, {"version", version}, {"verbs", std::move(verbs)}}.dump();
}

}  // namespace tarsier::cli
