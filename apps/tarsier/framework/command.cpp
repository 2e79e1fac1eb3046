// SPDX-License-Identifier: MIT
#include "command.h"

#include "tarsier/core/errors.h"

#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include "flag_info.h"
#include "parse.h"
#include <algorithm>
#include <cstdio>
#include <sstream>
#include <type_traits>
#include <utility>

namespace tarsier::cli {

const char* name_of(FlagType type) {
  switch (type) {
    case FlagType::kSwitch:
      return "switch";
    case FlagType::kInteger:
      return "integer";
    case FlagType::kNumber:
      return "number";
    case FlagType::kText:
      break;
  }
  return "text";
}

// --- rules ---

struct Check::Rule {
  CLI::Validator validator;
  FlagInfo info = {};  // range and choices
};

namespace {

template <class T>
constexpr FlagType type_of() {
  if constexpr (std::is_integral_v<T>) {
    return FlagType::kInteger;
  } else if constexpr (std::is_floating_point_v<T>) {
    return FlagType::kNumber;
  } else if constexpr (std::is_same_v<T, std::string>) {
    return FlagType::kText;
  } else {
    return type_of<typename T::value_type>();
  }
}

}  // namespace

Check::Check(std::shared_ptr<const Rule> rule) : rule_(std::move(rule)) {}

Check::Check(std::function<std::string(const std::string&)> problem)
    : Check(std::make_shared<const Rule>(Rule{CLI::Validator(
          [problem = std::move(problem)](std::string& text) { return problem(text); }, "")})) {}

Check::~Check() = default;

Check::Check(const Range& range)
    : Check([range](const std::string& text) {
        double value = 0;
        const bool good = CLI::detail::lexical_cast(text, value) && range.contains(value);
        return good ? std::string() : "expected " + range.text() + ", got " + text;
      }) {
  auto rule = std::make_shared<Rule>(*rule_);
  rule->info.range = range;
  rule_ = std::move(rule);
}

Check one_of(const std::vector<std::string>& choices) {
  Check::Rule rule{CLI::IsMember(choices)};
  rule.info.choices = choices;
  return Check(std::make_shared<const Check::Rule>(std::move(rule)));
}

Check one_of(std::initializer_list<std::string_view> choices) {
  return one_of(std::vector<std::string>(choices.begin(), choices.end()));
}

Check one_of(std::initializer_list<int> choices) {
  Check::Rule rule{CLI::IsMember(choices)};
  for (const int choice : choices) rule.info.choices.push_back(std::to_string(choice));
  return Check(std::make_shared<const Check::Rule>(std::move(rule)));
}

// --- flags ---

struct Flag::Parts {
  CLI::Option* option = nullptr;
  FlagType type = FlagType::kText;
  FlagInfo rules = {};  // range, choices, suggestions, headless value
};

Flag::Flag(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}
Flag::~Flag() = default;

Flag& Flag::check(const Check& check) {
  const Check::Rule& rule = *check.rule_;
  parts_->option->check(rule.validator);
  if (!rule.info.choices.empty()) parts_->rules.choices = rule.info.choices;
  if (rule.info.range) parts_->rules.range = rule.info.range;
  return *this;
}

Flag& Flag::show_default() {
  parts_->option->capture_default_str();
  return *this;
}

Flag& Flag::show_default(std::string_view text) {
  parts_->option->default_str(std::string(text));
  return *this;
}

Flag& Flag::required() {
  parts_->option->required();
  return *this;
}

Flag& Flag::group(std::string_view name) {
  parts_->option->group(std::string(name));
  return *this;
}

Flag& Flag::delimiter(char between) {
  parts_->option->delimiter(between);
  return *this;
}

Flag& Flag::expected(int count) {
  parts_->option->expected(count);
  return *this;
}

Flag& Flag::one_value_each() {
  parts_->option->type_size(1)->allow_extra_args(false);
  return *this;
}

Flag& Flag::excludes(Flag& other) {
  parts_->option->excludes(other.parts_->option);
  return *this;
}

Flag& Flag::needs(Flag& other) {
  parts_->option->needs(other.parts_->option);
  return *this;
}

Flag& Flag::suggest(std::vector<std::string> words) {
  parts_->rules.suggestions = std::move(words);
  return *this;
}

Flag& Flag::headless_value(std::string_view value) {
  parts_->rules.headless_value = value;
  return *this;
}

Flag& Flag::type_name(std::string_view name) {
  parts_->option->type_name(std::string(name));
  return *this;
}

std::size_t Flag::count() const { return parts_->option->count(); }

FlagInfo Flag::describe() const {
  const CLI::Option& option = *parts_->option;
  const auto sorted_names = [](const std::set<CLI::Option*>& others) {
    std::vector<std::string> names;
    names.reserve(others.size());
    for (const CLI::Option* other : others) names.push_back(other->get_name());
    std::sort(names.begin(), names.end());  // a set of pointers has no defined order
    return names;
  };
  FlagInfo flag = parts_->rules;
  flag.positional = option.get_positional() && option.get_lnames().empty();
  if (option.get_positional()) flag.positional_name = option.get_name(true, false);
  if (flag.positional) {
    flag.names = {flag.positional_name};
  } else {
    for (const std::string& name : option.get_lnames()) flag.names.push_back("--" + name);
    for (const std::string& name : option.get_snames()) flag.names.push_back('-' + name);
  }
  flag.max_items = option.get_items_expected_max();
  flag.type = parts_->type;
  if (flag.type != FlagType::kSwitch) {
    const std::string type = option.get_type_name();  // "INT:INT in [0 - 10]"
    flag.value = type.substr(0, type.find(':'));
    if (flag.value.empty() && !flag.positional) flag.value = "TEXT";
  }
  flag.default_value = option.get_default_str();
  flag.description = option.get_description();
  flag.group = option.get_group();
  flag.required = option.get_required();
  flag.many = option.get_expected_max() == CLI::detail::expected_max_vector_size;
  flag.min_values = option.get_expected_min();
  flag.needs = sorted_names(option.get_needs());
  flag.excludes = sorted_names(option.get_excludes());
  return flag;
}

// --- commands ---

struct Command::Parts {
  CLI::App* app = nullptr;
  std::unique_ptr<CLI::App> root = {};  // of the program itself
  const Command* parent = nullptr;
  std::string name;
  std::string description;
  std::string example = {};
  std::vector<std::unique_ptr<Command>> commands = {};
  std::vector<std::unique_ptr<Flag>> flags = {};
  std::function<void()> add_flags = {};  // adds the flags that are still missing
};

Command::Command(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {
  add(std::make_unique<Flag::Parts>(Flag::Parts{parts_->app->get_help_ptr(), FlagType::kSwitch}));
}

Command::Command(std::string_view name, std::string_view description)
    : Command([&] {
        auto app = std::make_unique<CLI::App>(std::string(description), std::string(name));
        auto parts = std::make_unique<Parts>(
            Parts{app.get(), nullptr, nullptr, std::string(name), std::string(description)});
        parts->root = std::move(app);
        return parts;
      }()) {}

Command::~Command() = default;

Command& Command::add_subcommand(std::string_view name, std::string_view description) {
  CLI::App* app = parts_->app->add_subcommand(std::string(name), std::string(description));
  auto parts = std::make_unique<Parts>(
      Parts{app, nullptr, this, std::string(name), std::string(description)});
  parts_->commands.push_back(std::unique_ptr<Command>(new Command(std::move(parts))));
  return *parts_->commands.back();
}

Flag& Command::add(std::unique_ptr<Flag::Parts> flag) {
  parts_->flags.push_back(std::unique_ptr<Flag>(new Flag(std::move(flag))));
  return *parts_->flags.back();
}

template <class T>
Flag& Command::bind(std::string_view names, T& value, std::string_view help) {
  CLI::Option* option = parts_->app->add_option(std::string(names), value, std::string(help));
  return add(std::make_unique<Flag::Parts>(Flag::Parts{option, type_of<T>()}));
}

Flag& Command::add_option(std::string_view names, int& value, std::string_view help) {
  return bind(names, value, help);
}
Flag& Command::add_option(std::string_view names, std::int64_t& value, std::string_view help) {
  return bind(names, value, help);
}
Flag& Command::add_option(std::string_view names, std::uint64_t& value, std::string_view help) {
  return bind(names, value, help);
}
Flag& Command::add_option(std::string_view names, unsigned& value, std::string_view help) {
  return bind(names, value, help);
}
Flag& Command::add_option(std::string_view names, float& value, std::string_view help) {
  return bind(names, value, help);
}
Flag& Command::add_option(std::string_view names, double& value, std::string_view help) {
  return bind(names, value, help);
}
Flag& Command::add_option(std::string_view names, std::string& value, std::string_view help) {
  return bind(names, value, help);
}
Flag& Command::add_option(std::string_view names, std::optional<int>& value,
                          std::string_view help) {
  return bind(names, value, help);
}
Flag& Command::add_option(std::string_view names, std::optional<double>& value,
                          std::string_view help) {
  return bind(names, value, help);
}
Flag& Command::add_option(std::string_view names, std::optional<std::string>& value,
                          std::string_view help) {
  return bind(names, value, help);
}
Flag& Command::add_option(std::string_view names, std::vector<int>& value, std::string_view help) {
  return bind(names, value, help);
}
Flag& Command::add_option(std::string_view names, std::vector<double>& value,
                          std::string_view help) {
  return bind(names, value, help);
}
Flag& Command::add_option(std::string_view names, std::vector<std::string>& value,
                          std::string_view help) {
  return bind(names, value, help);
}

Flag& Command::add_unbound_option(std::string_view names, std::string_view help) {
  const std::string text(help);
  CLI::Option* option = parts_->app->add_option(std::string(names), text);
  return add(std::make_unique<Flag::Parts>(Flag::Parts{option, FlagType::kText}));
}

Flag& Command::add_flag(std::string_view names, bool& value, std::string_view help) {
  CLI::Option* option = parts_->app->add_flag(std::string(names), value, std::string(help));
  return add(std::make_unique<Flag::Parts>(Flag::Parts{option, FlagType::kSwitch}));
}

Flag& Command::add_version_flag(std::string_view names) {
  CLI::Option* option = parts_->app->set_version_flag(std::string(names), std::string());
  return add(std::make_unique<Flag::Parts>(Flag::Parts{option, FlagType::kSwitch}));
}

void Command::add_flags_later(std::function<void()> add) { parts_->add_flags = std::move(add); }

void Command::add_flags_now() const {
  if (parts_->add_flags) std::exchange(parts_->add_flags, nullptr)();
}

void Command::require_subcommand(int count) { parts_->app->require_subcommand(count); }

void Command::require_subcommand(int min, int max) {
  parts_->app->require_subcommand(static_cast<std::size_t>(min), static_cast<std::size_t>(max));
}

void Command::group(std::string_view name) { parts_->app->group(std::string(name)); }

void Command::callback(std::function<void()> chosen) { parts_->app->callback(std::move(chosen)); }

void Command::example(std::string_view line) { parts_->example = line; }

const std::string& Command::name() const { return parts_->name; }
const std::string& Command::description() const { return parts_->description; }
const std::string& Command::example() const { return parts_->example; }
bool Command::hidden() const { return parts_->app->get_group().empty(); }
const Command* Command::parent() const { return parts_->parent; }
int Command::min_subcommands() const {
  return static_cast<int>(parts_->app->get_require_subcommand_min());
}

std::vector<const Command*> Command::subcommands() const {
  std::vector<const Command*> commands;
  for (const auto& command : parts_->commands) commands.push_back(command.get());
  return commands;
}

std::vector<FlagInfo> Command::flags() const {
  add_flags_now();
  std::vector<FlagInfo> flags;
  for (const auto& flag : parts_->flags) flags.push_back(flag->describe());
  return flags;
}

const Command* Command::find(std::string_view name) const {
  for (const auto& command : parts_->commands) {
    if (command->name() == name) return command.get();
  }
  return nullptr;
}

Command* Command::find(std::string_view name) {
  return const_cast<Command*>(std::as_const(*this).find(name));
}

namespace {

// CLI11's messages about the number of values, as sentences:
// "--a: 1 required TEXT missing", "--a: At Most 1 required but received 2", "--a: At least 2 ..".
std::string plain_message(const std::string& text) {
  const std::size_t colon = text.find(": ");
  if (colon == std::string::npos) return text;
  const std::string name = text.substr(0, colon);
  const std::string rest = text.substr(colon + 2);
  int expected = 0;
  int received = 0;
  if (std::sscanf(rest.c_str(), "At Most %d required but received %d", &expected, &received) == 2)
    return fmt::format("{}: at most {} allowed, but {} given", name, expected, received);
  if (std::sscanf(rest.c_str(), "At least %d required but received %d", &expected, &received) == 2)
    return fmt::format("{}: {} values needed, but {} given", name, expected, received);
  if (rest.ends_with(" missing") && std::sscanf(rest.c_str(), "%d required", &expected) == 1)
    return expected == 1 ? name + " needs a value"
                         : fmt::format("{} needs {} values", name, expected);
  return text;
}

}  // namespace

Command::Parsed Command::parse(std::vector<std::string> words) {
  for (const Command* chosen = match_command(*this, words).command; chosen != nullptr;
       chosen = chosen->parent())
    chosen->add_flags_now();
  Parsed parsed;
  std::reverse(words.begin(), words.end());  // CLI11 reads them from the end
  try {
    parts_->app->parse(words);
  } catch (const CLI::CallForHelp&) {
    parsed.outcome = Outcome::kHelp;
  } catch (const CLI::CallForVersion&) {
    parsed.outcome = Outcome::kVersion;
  } catch (const CLI::ParseError& error) {
    throw UsageError(plain_message(error.what()));
  }
  parsed.command = this;
  for (const CLI::App* app = parts_->app; !app->get_subcommands().empty();) {
    app = app->get_subcommands().front();
    parsed.command = parsed.command->find(app->get_name());
  }
  return parsed;
}

std::string parser_version() { return CLI11_VERSION; }

std::vector<ConfigEntry> read_config(const std::string& text) {
  std::istringstream stream(text);
  std::vector<ConfigEntry> entries;
  for (const CLI::ConfigItem& item : CLI::ConfigTOML().from_config(stream)) {
    if (item.name == "++" || item.name == "--") continue;  // marks of a section's begin and end
    entries.push_back({item.parents, item.name, item.inputs});
  }
  return entries;
}

}  // namespace tarsier::cli
