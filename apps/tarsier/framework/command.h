// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <cstdint>
#include <functional>
#include <initializer_list>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

// The command line of the program: areas, verbs and their flags. Only command.cpp includes the
// parser behind it (CLI11), because its headers would add several seconds to the compilation of
// every verb.
//
//   Command& verb = area.add_subcommand("read", "reads the plates of images");
//   verb.add_option("INPUT", flags.inputs, "images").required();
//   verb.add_option("--iou", flags.iou, "of boxes").check(range(0.0, 1.0)).show_default();
//   verb.add_flag("--errors", flags.errors, "list what was missed");

namespace tarsier::cli {

struct FlagInfo;

// A rule for values. Each value of a list must satisfy it.
class Check {
 public:
  // `problem` gets the value as typed and returns what is wrong with it, or an empty string.
  explicit Check(std::function<std::string(const std::string&)> problem);
  // The value must be a number of this range.
  Check(const Range& range);
  ~Check();

 private:
  friend class Flag;
  friend Check one_of(const std::vector<std::string>& choices);
  friend Check one_of(std::initializer_list<int> choices);
  struct Rule;
  explicit Check(std::shared_ptr<const Rule> rule);
  std::shared_ptr<const Rule> rule_;
};

// The value must be one of these words or numbers.
[[nodiscard]] Check one_of(const std::vector<std::string>& choices);
[[nodiscard]] Check one_of(std::initializer_list<std::string_view> choices);
[[nodiscard]] Check one_of(std::initializer_list<int> choices);

// One flag or positional input. Its Command owns it.
class Flag {
 public:
  Flag(const Flag&) = delete;
  Flag& operator=(const Flag&) = delete;
  ~Flag();

  Flag& check(const Check& check);
  // --help shows the variable's current value as the default.
  Flag& show_default();
  Flag& show_default(std::string_view text);
  Flag& required();
  // Heading in --help; hidden from --help if empty.
  Flag& group(std::string_view name);
  // Several values may be written as one word: "1,2,3".
  Flag& delimiter(char between);
  // Requires exactly `count` values.
  Flag& expected(int count);
  // For a list: the flag is repeated, with one value each time.
  Flag& one_value_each();
  // The flag excludes `other`; the flag requires `other`.
  Flag& excludes(Flag& other);
  Flag& needs(Flag& other);
  // Words that a text may be, among other values; for forms that are made of the flags.
  Flag& suggest(std::vector<std::string> words);
  // Without this flag the verb opens a window; with this value it opens none.
  Flag& headless_value(std::string_view value);
  // What --help shows for the value instead of INT, FLOAT or TEXT.
  Flag& type_name(std::string_view name);

  // How often the flag was given.
  [[nodiscard]] std::size_t count() const;
  [[nodiscard]] FlagInfo describe() const;

 private:
  friend class Command;
  struct Parts;
  explicit Flag(std::unique_ptr<Parts> parts);
  std::unique_ptr<Parts> parts_;
};

// The program, an area or a verb. It owns its parts; the variables bound to flags must outlive it.
class Command {
 public:
  // The program itself.
  Command(std::string_view name, std::string_view description);
  Command(const Command&) = delete;
  Command& operator=(const Command&) = delete;
  ~Command();

  Command& add_subcommand(std::string_view name, std::string_view description);

  // `names` is "-o,--output", "INPUT" (positional), or both. If the flag is not given the variable
  // keeps its value. Numbers must fit the variable's type.
  Flag& add_option(std::string_view names, int& value, std::string_view help = {});
  Flag& add_option(std::string_view names, std::int64_t& value, std::string_view help = {});
  Flag& add_option(std::string_view names, std::uint64_t& value, std::string_view help = {});
  Flag& add_option(std::string_view names, unsigned& value, std::string_view help = {});
  Flag& add_option(std::string_view names, float& value, std::string_view help = {});
  Flag& add_option(std::string_view names, double& value, std::string_view help = {});
  Flag& add_option(std::string_view names, std::string& value, std::string_view help = {});
  Flag& add_option(std::string_view names, std::optional<int>& value, std::string_view help = {});
  Flag& add_option(std::string_view names, std::optional<double>& value,
                   std::string_view help = {});
  Flag& add_option(std::string_view names, std::optional<std::string>& value,
                   std::string_view help = {});
  Flag& add_option(std::string_view names, std::vector<int>& value, std::string_view help = {});
  Flag& add_option(std::string_view names, std::vector<double>& value, std::string_view help = {});
  Flag& add_option(std::string_view names, std::vector<std::string>& value,
                   std::string_view help = {});
  // A text that is read before the parser runs, or not at all.
  Flag& add_unbound_option(std::string_view names, std::string_view help);
  // A switch. In "--pepper,!--no-pepper" the second name switches it off.
  Flag& add_flag(std::string_view names, bool& value, std::string_view help = {});
  // Makes parse() return kVersion.
  Flag& add_version_flag(std::string_view names);

  // `add` adds the flags when they are needed: when a command line chooses this command, or in
  // flags(). This saves time, because a command line chooses one verb of many.
  void add_flags_later(std::function<void()> add);

  // Requires exactly `count` sub-commands, or min..max of them.
  void require_subcommand(int count);
  void require_subcommand(int min, int max);
  // Heading in the help of the parent command; hidden from it if empty.
  void group(std::string_view name);
  // Called when this command was chosen and all its flags were read.
  void callback(std::function<void()> chosen);
  // A complete example command line, shown by --help.
  void example(std::string_view line);

  [[nodiscard]] const std::string& name() const;
  [[nodiscard]] const std::string& description() const;
  [[nodiscard]] const std::string& example() const;
  // Whether the command is hidden from help.
  [[nodiscard]] bool hidden() const;
  // Null for the program itself.
  [[nodiscard]] const Command* parent() const;
  // In the order in which they were added.
  [[nodiscard]] std::vector<const Command*> subcommands() const;
  // The minimum count of sub-commands, for "SUBCOMMAND" in the usage line; 0 if none is required.
  [[nodiscard]] int min_subcommands() const;
  // All flags in the order in which they were added, --help first; hidden flags have no group.
  [[nodiscard]] std::vector<FlagInfo> flags() const;
  // The sub-command `name`, or null.
  [[nodiscard]] const Command* find(std::string_view name) const;
  [[nodiscard]] Command* find(std::string_view name);

  enum class Outcome { kRun, kHelp, kVersion };
  struct Parsed {
    Outcome outcome = Outcome::kRun;
    // The last command of the command line.
    const Command* command = nullptr;
  };
  // Parses a command line without the program's name and calls the callbacks of the chosen
  // commands. Call it only once. Throws UsageError if the command line breaks a rule.
  Parsed parse(std::vector<std::string> words);

 private:
  struct Parts;
  explicit Command(std::unique_ptr<Parts> parts);
  void add_flags_now() const;
  Flag& add(std::unique_ptr<Flag::Parts> flag);
  template <class T>
  Flag& bind(std::string_view names, T& value, std::string_view help);
  std::unique_ptr<Parts> parts_;
};

// One value of a configuration file (TOML or INI).
struct ConfigEntry {
  // The parts of its section: "plate", "read" for [plate.read].
  std::vector<std::string> parents;
  std::string name;
  std::vector<std::string> values;
};

// Returns the entries in the order of the text. Throws std::exception if the text is neither TOML
// nor INI.
[[nodiscard]] std::vector<ConfigEntry> read_config(const std::string& text);

}  // namespace tarsier::cli
