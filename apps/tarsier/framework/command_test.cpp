// SPDX-License-Identifier: MIT
#include "command.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/testing_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "command_json.h"
#include "command_tree.h"
#include "option_names.h"
#include "parse.h"
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

// A verb "area verb" with one flag of each kind.
struct Line {
  Command root{"tarsier", "a program"};
  Command& area = root.add_subcommand("area", "verbs of a kind");
  Command& verb = area.add_subcommand("verb", "does it");
  int runs = 0;

  int integer = 7;
  std::int64_t large = 0;
  std::uint64_t natural = 0;
  unsigned small_natural = 0;
  double number = 0.5;
  float small_number = 0;
  std::string text = "as it was";
  bool on = false;
  bool off = true;
  std::optional<int> maybe_integer;
  std::optional<double> maybe_number;
  std::optional<std::string> maybe_text;
  std::vector<int> integers;
  std::vector<double> numbers;
  std::vector<std::string> texts;
  std::vector<std::string> inputs;

  Line() {
    root.require_subcommand(0, 1);
    root.add_version_flag("--version");
    area.require_subcommand(1);
    verb.add_option("INPUT", inputs, "images").type_name("");
    verb.add_option("--integer", integer, "a count").show_default();
    verb.add_option("--large", large);
    verb.add_option("--natural", natural);
    verb.add_option("--small-natural", small_natural);
    verb.add_option("-n,--number", number, "a share").check(range(0.0, 1.0)).show_default();
    verb.add_option("--small-number", small_number);
    verb.add_option("--text", text, "a name").group("Names");
    verb.add_flag("--on", on, "a switch");
    verb.add_flag("--off,!--no-off", off, "a switch").show_default("on");
    verb.add_option("--maybe-integer", maybe_integer);
    verb.add_option("--maybe-number", maybe_number);
    verb.add_option("--maybe-text", maybe_text);
    verb.add_option("--integers", integers, "sizes").delimiter(',');
    verb.add_option("--numbers", numbers, "two ends").delimiter(',').expected(2);
    verb.add_option("--texts", texts, "names").one_value_each();
    verb.add_unbound_option("--config", "a file").type_name("FILE").group("Common");
    verb.callback([this] { ++runs; });
  }

  Command::Parsed parse(std::vector<std::string> words) {
    words.insert(words.begin(), {"area", "verb"});
    return parse_command_line(root, std::move(words));
  }

  std::string error(std::vector<std::string> words) {
    try {
      parse(std::move(words));
    } catch (const UsageError& caught) {
      return caught.what();
    }
    return "no error";
  }

  FlagInfo flag(const std::string& name) {
    for (FlagInfo& flag : verb.flags()) {
      if (flag.names.front() == name) return flag;
    }
    ADD_FAILURE() << name;
    return {};
  }
};

TEST(Command, ReadsEveryTypeOfValue) {
  Line line;
  const Command::Parsed parsed = line.parse({"a.png",
                                             "b.png",
                                             "--integer",
                                             "-3",
                                             "--large",
                                             "-9000000000",
                                             "--natural",
                                             "9000000000",
                                             "-n",
                                             "0.25",
                                             "--text",
                                             "Ann Other",
                                             "--small-number",
                                             "1e-3",
                                             "--on",
                                             "--no-off",
                                             "--integers",
                                             "1,2,3",
                                             "--numbers",
                                             "0.5,2",
                                             "--texts",
                                             "a b",
                                             "--texts",
                                             "c",
                                             "--maybe-text",
                                             "m",
                                             "--small-natural=4",
                                             "--maybe-integer=5",
                                             "--maybe-number=0.5"});
  EXPECT_EQ(parsed.outcome, Command::Outcome::kRun);
  EXPECT_EQ(parsed.command, &line.verb);
  EXPECT_EQ(line.runs, 1);
  EXPECT_THAT(line.inputs, ElementsAre("a.png", "b.png"));
  EXPECT_EQ(line.integer, -3);
  EXPECT_EQ(line.large, -9000000000);
  EXPECT_EQ(line.natural, 9000000000U);
  EXPECT_EQ(line.small_natural, 4U);
  EXPECT_EQ(line.number, 0.25);
  EXPECT_FLOAT_EQ(line.small_number, 1e-3F);
  EXPECT_EQ(line.text, "Ann Other");
  EXPECT_TRUE(line.on);
  EXPECT_FALSE(line.off);
  EXPECT_EQ(line.maybe_integer, 5);
  EXPECT_EQ(line.maybe_number, 0.5);
  EXPECT_EQ(line.maybe_text, "m");
  EXPECT_THAT(line.integers, ElementsAre(1, 2, 3));
  EXPECT_THAT(line.numbers, ElementsAre(0.5, 2));
  EXPECT_THAT(line.texts, ElementsAre("a b", "c"));
}

TEST(Command, KeepsDefaultsOfMissingFlags) {
  Line line;
  line.parse({});
  EXPECT_EQ(line.runs, 1);
  EXPECT_EQ(line.integer, 7);
  EXPECT_EQ(line.number, 0.5);
  EXPECT_EQ(line.text, "as it was");
  EXPECT_TRUE(line.off);
  EXPECT_EQ(line.maybe_integer, std::nullopt);
  EXPECT_THAT(line.inputs, IsEmpty());
}

TEST(Command, RefusesInvalidValues) {
  for (const char* word : {"--integer=x", "--integer=1.5", "--integer=3000000000", "--number=half",
                           "--small-natural=5000000000", "--integers=1,b", "--numbers=1"}) {
    Line line;
    const std::string name = std::string(word).substr(0, std::string(word).find('='));
    EXPECT_THAT(line.error({word}), HasSubstr(name)) << word;
    EXPECT_EQ(line.runs, 0) << word;
  }
  Line line;
  EXPECT_THAT(line.error({"--text"}), HasSubstr("--text"));
}

TEST(Command, ReportsHelpAndVersionAsOutcomes) {
  Line line;
  Command::Parsed parsed = line.parse({"--help"});
  EXPECT_EQ(parsed.outcome, Command::Outcome::kHelp);
  EXPECT_EQ(parsed.command, &line.verb);
  Line other;
  parsed = parse_command_line(other.root, {"area", "--help"});
  EXPECT_EQ(parsed.outcome, Command::Outcome::kHelp);
  EXPECT_EQ(parsed.command, &other.area);
  Line third;
  EXPECT_EQ(parse_command_line(third.root, {"--version"}).outcome, Command::Outcome::kVersion);
}

TEST(Check, ChecksRangesAndChoices) {
  const auto accepts = [](const Check& check, const std::string& word) {
    Command root("tarsier", "");
    Command& verb = root.add_subcommand("verb", "");
    std::string value;
    verb.add_option("--value", value).check(check);
    try {
      root.parse({"verb", "--value=" + word});
    } catch (const UsageError&) {
      return false;
    }
    return true;
  };
  EXPECT_TRUE(accepts(range(1, 3), "1"));
  EXPECT_TRUE(accepts(range(1, 3), "3"));
  EXPECT_FALSE(accepts(range(1, 3), "4"));
  EXPECT_FALSE(accepts(odd_range(1, 3), "2"));
  EXPECT_FALSE(accepts(range(1, 3), "nan"));
  EXPECT_TRUE(accepts(range(0.5, 1.0), "0.75"));
  EXPECT_FALSE(accepts(range(0.5, 1.0), "0.25"));
  EXPECT_FALSE(accepts(range(0.5, 1.0), "half"));
  EXPECT_TRUE(accepts(above(0), "1e-9"));
  EXPECT_FALSE(accepts(above(0), "0"));
  EXPECT_TRUE(accepts(at_least(0), "0"));
  EXPECT_FALSE(accepts(at_least(0), "-1"));
  EXPECT_TRUE(accepts(one_of({"a", "b"}), "b"));
  EXPECT_FALSE(accepts(one_of({"a", "b"}), "c"));
  EXPECT_TRUE(accepts(one_of(std::vector<std::string>{"x"}), "x"));
  EXPECT_TRUE(accepts(one_of({0, 1}), "1"));
  EXPECT_FALSE(accepts(one_of({0, 1}), "2"));
  const Check even([](const std::string& text) {
    return text.size() % 2 == 0 ? std::string() : "an even number of letters";
  });
  EXPECT_TRUE(accepts(even, "ab"));
  EXPECT_FALSE(accepts(even, "abc"));
}

TEST(Flag, ChecksRequiredExcludesAndNeeds) {
  const auto error = [](const std::vector<std::string>& words) -> std::string {
    Command root("tarsier", "");
    Command& verb = root.add_subcommand("verb", "");
    std::string name;
    bool a = false, b = false, c = false;
    std::string text;
    std::vector<double> pair;
    verb.add_option("NAME", name).required();
    verb.add_option("--text", text);
    verb.add_option("--pair", pair).expected(2);
    Flag& first = verb.add_flag("--first", a);
    verb.add_flag("--second", b).excludes(first);
    verb.add_flag("--third", c).needs(first);
    std::vector<std::string> line = {"verb"};
    line.insert(line.end(), words.begin(), words.end());
    try {
      root.parse(line);
    } catch (const UsageError& caught) {
      return caught.what();
    }
    EXPECT_EQ(first.count(), static_cast<std::size_t>(a));
    return "";
  };
  EXPECT_EQ(error({"Ann", "--first", "--third"}), "");
  EXPECT_EQ(error({"Ann", "--second"}), "");
  EXPECT_THAT(error({}), HasSubstr("NAME is required"));
  EXPECT_EQ(error({"Ann", "--second", "--first"}), "--first excludes --second");
  EXPECT_EQ(error({"Ann", "--third"}), "--third requires --first");
  EXPECT_EQ(error({"Ann", "--text"}), "--text needs a value");
  EXPECT_EQ(error({"Ann", "--text", "a", "--text", "b"}), "--text: at most 1 allowed, but 2 given");
  EXPECT_EQ(error({"Ann", "--pair", "1"}), "--pair: 2 values needed, but 1 given");
}

TEST(Flag, DescribeReturnsTypeDefaultRangeAndGroup) {
  Line line;
  const FlagInfo integer = line.flag("--integer");
  EXPECT_EQ(integer.type, FlagType::kInteger);
  EXPECT_EQ(integer.value, "INT");
  EXPECT_EQ(integer.default_value, "7");
  EXPECT_EQ(integer.description, "a count");
  EXPECT_EQ(integer.group, "Options");
  EXPECT_FALSE(integer.many);

  const FlagInfo number = line.flag("--number");
  EXPECT_THAT(number.names, ElementsAre("--number", "-n"));
  EXPECT_EQ(number.type, FlagType::kNumber);
  ASSERT_TRUE(number.range);
  EXPECT_EQ(number.range->text(), "0..1");

  const FlagInfo inputs = line.flag("INPUT");
  EXPECT_TRUE(inputs.positional);
  EXPECT_TRUE(inputs.many);
  EXPECT_EQ(inputs.value, "");

  EXPECT_EQ(line.flag("--on").type, FlagType::kSwitch);
  EXPECT_EQ(line.flag("--on").value, "");
  EXPECT_THAT(line.flag("--off").names, ElementsAre("--off", "--no-off"));
  EXPECT_EQ(line.flag("--text").group, "Names");
  EXPECT_EQ(line.flag("--config").value, "FILE");
  EXPECT_EQ(line.flag("--natural").value, "UINT");
  EXPECT_EQ(line.flag("--integers").type, FlagType::kInteger);
  EXPECT_EQ(line.flag("--numbers").min_values, 2);
}

TEST(ParseCommandLine, SuggestsTheMostSimilarWord) {
  Line line;
  EXPECT_EQ(line.error({"--integr", "3"}),
            "'tarsier area verb' has no flag --integr: did you mean --integer?");
  EXPECT_EQ(line.error({"--zzzzzzzz"}),
            "'tarsier area verb' has no flag --zzzzzzzz: see tarsier area verb --help");
  const auto error = [&line](std::vector<std::string> words) -> std::string {
    try {
      parse_command_line(line.root, std::move(words));
    } catch (const UsageError& caught) {
      return caught.what();
    }
    return "no error";
  };
  EXPECT_EQ(error({"aera"}), "'tarsier' knows no 'aera': did you mean 'area'?");
  EXPECT_EQ(error({"area", "xxxxxxxxx"}), "'tarsier area' knows no 'xxxxxxxxx': known: verb");
  EXPECT_EQ(error({"--json"}),
            "unknown flag --json here: flags come after the verb (tarsier --help)");
  EXPECT_EQ(nearest_word("recgonise", {"recognise", "train"}), "recognise");
  EXPECT_EQ(nearest_word("banana", {"recognise", "train"}), "");
}

class Config : public testing::Test {
 protected:
  std::string write(const std::string& text) {
    const std::string path = folder_ / "flags.toml";
    std::ofstream(path) << text;
    return path;
  }
  std::string error(const std::string& text) { return Line().error({"--config", write(text)}); }

  TemporaryFolder folder_;
};

TEST_F(Config, CommandLineOverridesConfigFile) {
  const std::string path = write(
      "integer = 3\nnumber = 0.125\non = true\nintegers = [4, 5]\n"
      "texts = [\"a\", \"b=c\"]\n[area.verb]\ntext = \"Ann Other\"\n");
  Line line;
  line.parse({"--config", path, "-n", "0.75"});
  EXPECT_EQ(line.integer, 3);
  EXPECT_EQ(line.number, 0.75);
  EXPECT_TRUE(line.on);
  EXPECT_EQ(line.text, "Ann Other");
  EXPECT_THAT(line.integers, ElementsAre(4, 5));
  EXPECT_THAT(line.texts, ElementsAre("a", "b=c"));
}

TEST_F(Config, ReportsInvalidEntries) {
  EXPECT_THAT(error("intger = 3\n"), HasSubstr("has no option 'intger': did you mean 'integer'?"));
  EXPECT_THAT(error("[plate.read]\niou = 3\n"),
              HasSubstr("[plate.read.iou] is not an area and verb"));
  EXPECT_THAT(error("number = 3\n"), HasSubstr("--number: expected 0..1, got 3"));
  EXPECT_THROW(Line().parse({"--config", folder_ / "none.toml"}), InputError);
}

TEST(ParseCommandLine, AcceptsFormerFlagNames) {
  const TemporaryFolder folder;
  const std::string config = folder / "former.toml";
  std::ofstream(config) << "most-frames = 9\n";
  Command root{"tarsier", "a program"};
  Command& area = root.add_subcommand("area", "verbs of a kind");
  Command& verb = area.add_subcommand("verb", "does it");
  int side = 0;
  int frames = 0;
  verb.add_option("--min-side", side);
  verb.add_option("--max-frames", frames);
  std::string file;
  verb.add_option("--config", file);
  (void)parse_command_line(root, {"area", "verb", "--least-side=30", "--config", config});
  EXPECT_EQ(side, 30);
  EXPECT_EQ(frames, 9);
  EXPECT_THROW((void)parse_command_line(root, {"area", "verb", "--least-frames", "3"}), UsageError);
}

TEST(HelpText, ShowsTypesRangesDefaultsAndGroups) {
  Command root("tarsier", "a program");
  Command& verb = root.add_subcommand("verb", "does it");
  std::vector<std::string> inputs;
  int count = 3;
  std::string output, mode;
  bool hidden = false, loud = false;
  verb.add_option("INPUT", inputs, "images").required().type_name("");
  verb.add_option("-o,--output", output, "file");
  verb.add_option("--count-of-them-all", count, "how many").check(range(1, 9)).show_default();
  Flag& choice = verb.add_option("--mode", mode, "how").check(one_of({"a", "b"})).group("More");
  verb.add_flag("--loud", loud, "with a noise").group("More").needs(choice);
  verb.add_flag("--hidden", hidden).group("");
  verb.example("tarsier verb a.png");
  EXPECT_EQ(help_text(verb),
            "does it\n"
            "Usage: tarsier verb [OPTIONS] INPUT...\n"
            "Example: tarsier verb a.png\n"
            "\n"
            "Positionals:\n"
            "  INPUT ... REQUIRED          images\n"
            "\n"
            "Options:\n"
            "  -h,--help                   Print this help message and exit\n"
            "  -o,--output TEXT            file\n"
            "  --count-of-them-all INT (1..9)=3\n"
            "                              how many\n"
            "\n"
            "\n"
            "More:\n"
            "  --mode {a,b}                how\n"
            "  --loud Needs: --mode        with a noise\n"
            "\n"
            "\n");
  EXPECT_THAT(help_text(root), HasSubstr("Subcommands:\n  verb                        does it\n"));
}

TEST(CommandJson, DescribesEveryFlag) {
  Line line;
  Command& other = line.area.add_subcommand("other", "does something else");
  std::string mode = "a";
  std::vector<int> sizes = {60, 25};
  double above = 0.5;
  other.add_option("--mode", mode, "how").check(one_of({"a", "b"})).show_default();
  other.add_option("-o,--sizes,SIZES", sizes, "px").delimiter(',').show_default().required();
  other.add_option("--above", above).check(tarsier::above(0)).show_default();
  std::string page = "a4";
  std::string output;
  other.add_option("--page", page, "a4, letter or 200x300mm").suggest({"a4", "letter"});
  other.add_option("--output", output, "a file [the window]").headless_value("none");
  bool fast = false;
  other.add_flag("--fast", fast).excludes(other.add_flag("--slow", fast));
  const auto document = nlohmann::json::parse(command_json(command_tree(line.root), "1.2"));
  EXPECT_EQ(document["program"], "tarsier");
  EXPECT_EQ(document["version"], "1.2");
  ASSERT_EQ(document["verbs"].size(), 2U);
  const nlohmann::json& first = document["verbs"][0];
  EXPECT_EQ(first["verb"], "area verb");
  EXPECT_EQ(first["path"], (nlohmann::json{"area", "verb"}));
  EXPECT_EQ(first["help"], "does it");
  ASSERT_EQ(first["inputs"].size(), 1U);
  EXPECT_EQ(first["inputs"][0]["names"], nlohmann::json::array({"INPUT"}));
  EXPECT_EQ(first["inputs"][0]["repeatable"], true);

  std::map<std::string, nlohmann::json> flags;
  for (const auto& verb : document["verbs"]) {
    for (const auto& flag : verb["flags"]) flags[flag["names"][0]] = flag;
  }
  EXPECT_EQ(flags.count("--help"), 0U);
  EXPECT_EQ(flags["--integer"]["type"], "integer");
  EXPECT_EQ(flags["--integer"]["default"], 7);
  EXPECT_EQ(flags["--integer"]["range"], nullptr);
  EXPECT_EQ(flags["--number"]["default"], 0.5);
  EXPECT_EQ(flags["--number"]["range"], (nlohmann::json{{"min", 0},
                                                        {"max", 1},
                                                        {"min_excluded", false},
                                                        {"max_excluded", false},
                                                        {"odd", false}}));
  EXPECT_EQ(flags["--number"]["unit"], nullptr);
  EXPECT_EQ(flags["--sizes"]["unit"], "px");
  EXPECT_EQ(flags["--above"]["range"], (nlohmann::json{{"min", 0},
                                                       {"max", nullptr},
                                                       {"min_excluded", true},
                                                       {"max_excluded", false},
                                                       {"odd", false}}));
  EXPECT_EQ(flags["--on"]["type"], "switch");
  EXPECT_EQ(flags["--on"]["default"], false);
  EXPECT_EQ(flags["--off"]["default"], true);
  EXPECT_EQ(flags["--text"]["default"], nullptr);
  EXPECT_EQ(flags["--text"]["group"], "Names");
  EXPECT_EQ(flags["--mode"]["choices"], (nlohmann::json{"a", "b"}));
  EXPECT_EQ(flags["--mode"]["default"], "a");
  EXPECT_EQ(flags["--mode"]["suggestions"], nlohmann::json::array());
  EXPECT_EQ(flags["--mode"]["headless_value"], nullptr);
  EXPECT_EQ(flags["--page"]["choices"], nlohmann::json::array());
  EXPECT_EQ(flags["--page"]["suggestions"], (nlohmann::json{"a4", "letter"}));
  EXPECT_EQ(flags["--output"]["headless_value"], "none");
  EXPECT_EQ(flags["--sizes"]["default"], (nlohmann::json{60, 25}));
  EXPECT_EQ(flags["--sizes"]["positional"], "SIZES");
  EXPECT_EQ(flags["--sizes"]["required"], true);
  EXPECT_EQ(flags["--numbers"]["values"], 2);
  EXPECT_EQ(flags["--fast"]["excludes"], nlohmann::json::array({"--slow"}));
  EXPECT_EQ(flags["--slow"]["excludes"], nlohmann::json::array({"--fast"}));
}

// Every start of the program adds all verbs, and runs one of them.
TEST(Command, AddsFlagsOnlyWhenNeeded) {
  Command root("tarsier", "a program");
  Command& area = root.add_subcommand("area", "verbs of a kind");
  int count = 0;
  int added = 0;
  int others = 0;
  Command& verb = area.add_subcommand("verb", "does it");
  verb.add_flags_later([&] {
    ++added;
    verb.add_option("--count", count, "how many");
  });
  Command& other = area.add_subcommand("other", "does something else");
  other.add_flags_later([&] {
    ++others;
    other.add_option("--size", count, "how large");
  });
  (void)parse_command_line(root, {"area", "verb", "--count", "3"});
  EXPECT_EQ(count, 3);
  EXPECT_EQ(added, 1);
  EXPECT_EQ(others, 0);
  EXPECT_THAT(verb.flags(), SizeIs(2)) << "--help and its own";
  EXPECT_EQ(added, 1);
  EXPECT_THAT(other.flags(), SizeIs(2));
  EXPECT_THAT(help_text(other), HasSubstr("--size"));
  EXPECT_EQ(others, 1);
}

TEST(OptionNames, BecomeFlagsOfTheVerb) {
  const std::vector<std::string> flags = {"--ca-file", "--insecure", "--start", "-o"};
  EXPECT_EQ(with_flag_names("not trusted: name it (option 'ca_file'), or option 'insecure'", flags),
            "not trusted: name it (--ca-file), or --insecure");
  EXPECT_EQ(with_flag_names("option 'start' must be search", flags), "--start must be search");
}

TEST(OptionNames, LoseTheUnitIfTheFlagHasNone) {
  EXPECT_EQ(with_flag_names("more (option 'memory_gb')", {"--memory"}), "more (--memory)");
  EXPECT_EQ(with_flag_names("option 'memory_gb'", {"--memory", "--memory-gb"}), "--memory-gb");
  EXPECT_EQ(with_flag_names("option 'memory_used'", {"--memory"}), "option 'memory_used'");
}

TEST(OptionNames, OfOtherVerbsAreUnchanged) {
  for (const char* message :
       {"", "no such word", "option 'window', 80 px", "option 'start", "option ''", "option 'o'",
        "option 'x' and option 'y'", "options 'start'", "'start'"}) {
    EXPECT_EQ(with_flag_names(message, {"--start", "-o"}), message);
  }
  EXPECT_EQ(with_flag_names("option 'option 'start'", {"--start"}), "option '--start");
  EXPECT_EQ(with_flag_names("option 'start'", {}), "option 'start'");
}

}  // namespace
}  // namespace tarsier::cli
