// SPDX-License-Identifier: MIT
#include "command_tree.h"

#include <algorithm>
#include <memory>
#include <string_view>

namespace tarsier::cli {
namespace {

// CLI11 writes "TEXT:{a,b}", "INT:INT in [0 - 10]", "FLOAT:POSITIVE".
void describe_type(const std::string& type, FlagInfo& flag) {
  const std::size_t colon = type.find(':');
  flag.value = type.substr(0, colon);
  if (colon == std::string::npos) return;
  const std::string rule = type.substr(colon + 1);
  constexpr std::string_view kRange = " in [";
  const std::size_t brace = rule.find('{');
  const std::size_t in = rule.find(kRange);
  if (brace != std::string::npos && rule.find('}', brace) != std::string::npos) {
    const std::string list = rule.substr(brace + 1, rule.find('}', brace) - brace - 1);
    for (std::size_t from = 0; from <= list.size();) {
      const std::size_t end = std::min(list.find(',', from), list.size());
      flag.choices.push_back(list.substr(from, end - from));
      from = end + 1;
    }
  } else if (in != std::string::npos && rule.ends_with(']')) {
    flag.range = rule.substr(in + kRange.size(), rule.size() - in - kRange.size() - 1);
    const std::size_t dash = flag.range.find(" - ");
    if (dash != std::string::npos) flag.range.replace(dash, 3, "..");
  } else if (rule == "POSITIVE") {
    flag.range = "> 0";
  } else if (rule == "NONNEGATIVE") {
    flag.range = ">= 0";
  }
}

std::string usage_of(const CLI::App& app, const std::vector<FlagInfo>& flags) {
  std::string usage = "tarsier " + verb_of(app) + " [OPTIONS]";
  for (const FlagInfo& flag : flags) {
    if (!flag.positional) continue;
    const std::string name = flag.names.front() + (flag.many ? "..." : "");
    usage += ' ' + (flag.required ? name : '[' + name + ']');
  }
  return usage;
}

std::vector<const CLI::App*> shown_parts(const CLI::App& app) {
  return app.get_subcommands(
      [](const CLI::App* part) { return !part->get_name().empty() && !part->get_group().empty(); });
}

// As --help shows them: what is positional, then the flags of no group, then each group where it
// first appears.
void order_by_group(std::vector<FlagInfo>& flags) {
  std::vector<std::string> groups = {"Options", "OPTIONS"};
  for (const FlagInfo& flag : flags) {
    if (std::find(groups.begin(), groups.end(), flag.group) == groups.end()) {
      groups.push_back(flag.group);
    }
  }
  const auto rank = [&groups](const FlagInfo& flag) {
    if (flag.positional) return std::ptrdiff_t{-1};
    return std::find(groups.begin(), groups.end(), flag.group) - groups.begin();
  };
  std::stable_sort(flags.begin(), flags.end(),
                   [&rank](const FlagInfo& a, const FlagInfo& b) { return rank(a) < rank(b); });
}

void add_verbs(const CLI::App& app, std::vector<VerbInfo>& verbs) {
  const std::vector<const CLI::App*> parts = shown_parts(app);
  for (const CLI::App* part : parts) add_verbs(*part, verbs);
  if (!parts.empty()) return;
  VerbInfo verb;
  for (const CLI::App* at = &app; at->get_parent() != nullptr; at = at->get_parent()) {
    verb.path.insert(verb.path.begin(), at->get_name());
  }
  verb.description = app.get_description();
  verb.example = example_of(verb_of(app));
  for (const CLI::Option* option : app.get_options()) {
    if (option->get_group().empty() || option == app.get_help_ptr()) continue;
    verb.flags.push_back(describe(*option));
  }
  order_by_group(verb.flags);
  verb.usage = usage_of(app, verb.flags);
  verbs.push_back(std::move(verb));
}

std::string joined(const std::vector<std::string>& words, const char* between) {
  std::string result;
  for (const std::string& word : words) result += (result.empty() ? "" : between) + word;
  return result;
}

// As CLI11's, but an example stands below the usage, ranges and choices are said shortly, and a
// switch that is on from the start does not say how it is stored.
class HelpFormatter : public CLI::Formatter {
 public:
  std::string make_usage(const CLI::App* app, std::string name) const override {
    const std::string usage = CLI::Formatter::make_usage(app, name);
    const std::string example = example_of(verb_of(*app));
    return example.empty() ? usage : usage + "Example: " + example + '\n';
  }
  std::string make_option_name(const CLI::Option* option, bool is_positional) const override {
    if (is_positional) return CLI::Formatter::make_option_name(option, is_positional);
    // Short names first, as everybody writes them.
    std::vector<std::string> names;
    for (const std::string& name : option->get_snames()) names.push_back('-' + name);
    for (const std::string& name : option->get_lnames()) names.push_back("--" + name);
    return joined(names, ",");
  }
  std::string make_option_opts(const CLI::Option* option) const override {
    const FlagInfo flag = describe(*option);
    std::string text = flag.value.empty() ? "" : ' ' + flag.value;
    if (!flag.choices.empty()) text = " {" + joined(flag.choices, ",") + '}';
    if (!flag.range.empty()) text += " (" + flag.range + ')';
    if (!flag.default_value.empty()) text += '=' + flag.default_value;
    if (flag.many) text += " ...";
    if (!flag.many && option->get_expected_min() > 1) {
      text += " x " + std::to_string(option->get_expected_min());
    }
    if (flag.required) text += " REQUIRED";
    return text + relations("Needs", option->get_needs()) +
           relations("Excludes", option->get_excludes());
  }

 private:
  static std::string relations(const char* word, const std::set<CLI::Option*>& others) {
    std::vector<std::string> names;
    for (const CLI::Option* other : others) names.push_back(other->get_name());
    std::sort(names.begin(), names.end());  // a set of pointers has no order of its own
    return names.empty() ? "" : std::string(" ") + word + ": " + joined(names, " ");
  }
};

}  // namespace

FlagInfo describe(const CLI::Option& option) {
  FlagInfo flag;
  flag.positional = option.get_positional() && option.get_lnames().empty();
  if (flag.positional) {
    flag.names = {option.get_name(true, false)};
  } else {
    for (const std::string& name : option.get_lnames()) flag.names.push_back("--" + name);
    for (const std::string& name : option.get_snames()) flag.names.push_back('-' + name);
  }
  if (option.get_items_expected_max() != 0) {  // else a switch
    describe_type(option.get_type_name(), flag);
    if (flag.value.empty() && !flag.positional) flag.value = "TEXT";
  }
  flag.default_value = option.get_default_str();
  flag.description = option.get_description();
  flag.group = option.get_group();
  flag.required = option.get_required();
  flag.many = option.get_expected_max() == CLI::detail::expected_max_vector_size;
  return flag;
}

std::vector<AreaInfo> command_tree(const CLI::App& root) {
  std::vector<AreaInfo> areas;
  for (const CLI::App* part : shown_parts(root)) {
    AreaInfo area;
    area.name = part->get_name();
    area.description = part->get_description();
    add_verbs(*part, area.verbs);
    areas.push_back(std::move(area));
  }
  return areas;
}

std::string verb_of(const CLI::App& app) {
  if (app.get_parent() == nullptr) return {};
  const std::string above = verb_of(*app.get_parent());
  return above.empty() ? app.get_name() : above + ' ' + app.get_name();
}

std::string help_text(const CLI::App& app) {
  const HelpFormatter formatter;
  const std::string above = app.get_parent() == nullptr ? "" : verb_of(*app.get_parent());
  const std::string name = "tarsier" + (above.empty() ? "" : ' ' + above) +
                           (app.get_parent() == nullptr ? "" : ' ' + app.get_name());
  return formatter.make_help(&app, name, CLI::AppFormatMode::Normal);
}

}  // namespace tarsier::cli
