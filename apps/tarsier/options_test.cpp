// SPDX-License-Identifier: MIT
// Every struct of options with fields(): its ranges hold, and its flags have them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "framework/areas.h"
#include "framework/cli.h"
#include "framework/command_json.h"
#include "framework/command_tree.h"
#include "options_cases.h"
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>
#include <type_traits>

namespace tarsier::cli {
namespace {

std::vector<OptionsCase> all_options() {
  std::vector<OptionsCase> all;
  for (const auto& group : {face_options(), plate_options(), scene_options()}) {
    all.insert(all.end(), group.begin(), group.end());
  }
  return all;
}

// Calls `change` with a value just outside of each end of the range, where the type has one.
template <class T, class Change>
void for_each_value_out_of_range(const Range& range, const Change& change) {
  using Limits = std::numeric_limits<T>;
  const auto below = [](double end) {
    const T value = static_cast<T>(end);
    return std::is_integral_v<T> ? static_cast<T>(value - 1)
                                 : static_cast<T>(std::nextafter(value, -Limits::max()));
  };
  const auto beyond = [](double end) {
    const T value = static_cast<T>(end);
    return std::is_integral_v<T> ? static_cast<T>(value + 1)
                                 : static_cast<T>(std::nextafter(value, Limits::max()));
  };
  const bool natural = std::is_unsigned_v<T>;
  if (std::isfinite(range.min) && !(natural && range.min <= 0 && !range.above_min)) {
    change(range.above_min ? static_cast<T>(range.min) : below(range.min));
  }
  if (std::isfinite(range.max))
    change(range.below_max ? static_cast<T>(range.max) : beyond(range.max));
  if (range.odd) change(static_cast<T>(range.min + 1));
  if constexpr (std::is_floating_point_v<T>) change(Limits::quiet_NaN());
}

// The same of a field, which has its value again afterwards.
template <class Change>
void for_each_value_out_of_range(const OptionField& field, const Change& change) {
  std::visit(
      [&](auto* value) {
        using T = std::remove_pointer_t<decltype(value)>;
        const T before = *value;
        const auto set = [&](const auto& outside) {
          if constexpr (requires { value->push_back(outside); }) {
            value->push_back(outside);
          } else {
            *value = outside;
          }
          change();
          *value = before;
        };
        if constexpr (std::is_same_v<T, bool> || std::is_same_v<T, std::string>) {
        } else if constexpr (requires { typename T::value_type; }) {
          for_each_value_out_of_range<typename T::value_type>(field.range, set);
        } else {
          for_each_value_out_of_range<T>(field.range, set);
        }
      },
      field.value);
}

std::string problem_of(const std::function<void()>& check) {
  try {
    check();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(Options, DefaultsAreValid) {
  // Those that must be given something before they can be used.
  const std::set<std::string> incomplete = {"AnnotateOptions", "sfm::OnlineReconstructorOptions"};
  for (const OptionsCase& options : all_options()) {
    EXPECT_EQ(problem_of(options.check_ranges), "") << options.name;
    if (incomplete.count(options.name) == 0) {
      EXPECT_EQ(problem_of(options.check), "") << options.name;
    }
  }
}

TEST(Options, RefusesValuesOutOfRangeByName) {
  int refused = 0;
  for (const OptionsCase& options : all_options()) {
    for (const OptionField& field : options.fields) {
      if (field.range.text().empty()) continue;
      for_each_value_out_of_range(field, [&] {
        ++refused;
        const std::string expected = field.range.text();
        const std::string problem = problem_of(options.check);
        EXPECT_THAT(problem, testing::StartsWith(std::string(field.name) + ' ')) << options.name;
        EXPECT_THAT(problem, testing::HasSubstr(": expected " + expected)) << options.name;
      });
    }
  }
  EXPECT_GT(refused, 800);
}

TEST(Options, FieldNamesAreUnique) {
  for (const OptionsCase& options : all_options()) {
    std::set<std::string_view> names;
    for (const OptionField& field : options.fields) {
      EXPECT_TRUE(names.insert(field.name).second) << options.name << ' ' << field.name;
      EXPECT_EQ(field.flag.empty(), field.help.empty()) << options.name << ' ' << field.name;
    }
  }
}

// A struct that gets fields() must be added to all_options().
TEST(Options, AllOptionStructsAreTested) {
  std::size_t count = 0;
  for (const char* folder : {TARSIER_SOURCE "/src/tarsier", TARSIER_SOURCE "/apps/ui"}) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
      if (entry.path().extension() != ".h" || entry.path().filename() == "option_fields.h")
        continue;
      std::ifstream file(entry.path());
      for (std::string line; std::getline(file, line);) {
        if (line.find(" OptionFields fields()") != std::string::npos) ++count;
      }
    }
  }
  EXPECT_EQ(all_options().size(), count);
}

// --- flags ---

nlohmann::json described_verbs() {
  Context context;
  Command root{"tarsier", ""};
  add_areas(root, context);
  return nlohmann::json::parse(command_json(command_tree(root), version())).at("verbs");
}

// The flags of all verbs, by each of their names.
std::multimap<std::string, nlohmann::json> described_flags() {
  std::multimap<std::string, nlohmann::json> flags;
  for (const nlohmann::json& verb : described_verbs()) {
    for (const nlohmann::json& flag : verb.at("flags")) {
      for (const nlohmann::json& name : flag.at("names")) flags.emplace(name, flag);
    }
  }
  return flags;
}

bool same_range(const nlohmann::json& described, const Range& range) {
  if (range.text().empty()) return described.is_null();
  const auto same_end = [](const nlohmann::json& end, double value) {
    return std::isfinite(value) ? end.is_number() && end.get<double>() == value : end.is_null();
  };
  return described.is_object() && same_end(described.at("min"), range.min) &&
         same_end(described.at("max"), range.max) &&
         described.at("min_excluded") == range.above_min &&
         described.at("max_excluded") == range.below_max && described.at("odd") == range.odd;
}

TEST(Options, FlagsHaveTheRangesOfTheirFields) {
  const std::multimap<std::string, nlohmann::json> flags = described_flags();
  int checked = 0;
  for (const OptionsCase& options : all_options()) {
    for (const OptionField& field : options.fields) {
      if (field.flag.empty()) continue;
      const std::string name(field.flag.substr(0, field.flag.find(',')));
      const auto [first, last] = flags.equal_range(name);
      EXPECT_TRUE(std::any_of(
          first, last,
          [&](const auto& flag) { return same_range(flag.second.at("range"), field.range); }))
          << options.name << ' ' << field.name << ' ' << name << ' ' << field.range.text();
      ++checked;
    }
  }
  EXPECT_GT(checked, 80);
}

TEST(Options, EveryNumericFlagHasARange) {
  // Any number will do, or the verb's own words say what is expected.
  const std::set<std::string> without = {"--seed",      "--offset",      "--distance",
                                         "--downscale", "--calibration", "--smooth",
                                         "--outline",   "--eyes",        "--focal"};
  for (const nlohmann::json& verb : described_verbs()) {
    for (const nlohmann::json& flag : verb.at("flags")) {
      const bool number = flag.at("type") == "integer" || flag.at("type") == "number";
      const std::string name = flag.at("names").at(0);
      if (!number || !flag.at("choices").empty() || without.count(name) != 0) continue;
      EXPECT_TRUE(flag.at("range").is_object()) << verb.at("verb") << ' ' << name;
    }
  }
}

}  // namespace
}  // namespace tarsier::cli
