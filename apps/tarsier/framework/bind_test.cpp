// SPDX-License-Identifier: MIT
#include "bind.h"

#include "tarsier/core/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "flag_info.h"
#include <stdexcept>

namespace tarsier::cli {
namespace {

using testing::ElementsAre;

struct Options {
  int count = 7;
  double share = 0.5;
  bool fast = false;
  std::string name = "any";
  std::optional<double> focal;
  std::vector<int> sizes = {3, 5};
  int inner = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"count", count, range(6, 1000), "--count", "images of it"},
            {"share", share, inside(0, 1), "--share", "px, of the side"},
            {"fast", fast, "--fast", "a switch"},
            {"name", name, "--name", "a text"},
            {"focal", focal, above(0), "--focal", "px"},
            {"sizes", sizes, odd_range(3, 7), "--sizes", "px"},
            {"inner", inner, range(0, 1)}};
  }
};

struct Program {
  Command root{"tarsier", ""};
  Command& verb = root.add_subcommand("verb", "");
  Options options;

  std::string error(std::vector<std::string> words) {
    words.insert(words.begin(), "verb");
    try {
      root.parse(std::move(words));
    } catch (const UsageError& caught) {
      return caught.what();
    }
    return "";
  }
  FlagInfo flag(const std::string& name) {
    for (FlagInfo& flag : verb.flags()) {
      if (flag.names.front() == name) return flag;
    }
    ADD_FAILURE() << name;
    return {};
  }
};

TEST(Bind, BindAllAddsAFlagForEachFieldThatHasOne) {
  Program program;
  bind_all(program.verb, program.options, "Tuning");
  std::vector<std::string> names;
  for (const FlagInfo& flag : program.verb.flags()) names.push_back(flag.names.front());
  EXPECT_THAT(
      names, ElementsAre("--help", "--count", "--share", "--fast", "--name", "--focal", "--sizes"));
  const FlagInfo count = program.flag("--count");
  EXPECT_EQ(count.default_value, "7");
  EXPECT_EQ(count.description, "images of it");
  EXPECT_EQ(count.group, "Tuning");
  EXPECT_EQ(count.range->text(), "6..1000");
  EXPECT_EQ(program.flag("--fast").type, FlagType::kSwitch);
  EXPECT_FALSE(program.flag("--name").range);
  EXPECT_EQ(program.error(
                {"--count=8", "--share=0.25", "--fast", "--name=b", "--focal=900", "--sizes=3,7"}),
            "");
  EXPECT_EQ(program.options.count, 8);
  EXPECT_EQ(program.options.share, 0.25);
  EXPECT_TRUE(program.options.fast);
  EXPECT_EQ(program.options.name, "b");
  EXPECT_EQ(program.options.focal, 900);
  EXPECT_THAT(program.options.sizes, ElementsAre(3, 7));
}

TEST(Bind, RefusesValuesOutOfRange) {
  const auto error = [](const std::vector<std::string>& words) {
    Program program;
    bind_all(program.verb, program.options);
    return program.error(words);
  };
  EXPECT_EQ(error({"--count=5"}), "--count: expected 6..1000, got 5");
  EXPECT_EQ(error({"--count=6"}), "");
  EXPECT_EQ(error({"--count=1000"}), "");
  EXPECT_EQ(error({"--share=1"}), "--share: expected > 0, < 1, got 1");
  EXPECT_EQ(error({"--share=nan"}), "--share: expected > 0, < 1, got nan");
  EXPECT_EQ(error({"--share=half"}), "--share: expected > 0, < 1, got half");
  EXPECT_EQ(error({"--focal=0"}), "--focal: expected > 0, got 0");
  EXPECT_EQ(error({"--sizes", "3", "4"}), "--sizes: expected 3..7, odd, got 4");
  EXPECT_EQ(error({"--sizes=3,4"}), "--sizes: expected 3..7, odd, got 4");
}

TEST(Bind, BindFieldCanReplaceNameAndHelp) {
  Program program;
  bind_field(program.verb, program.options, program.options.share);
  bind_field(program.verb, program.options, program.options.inner, "--depth", "of it")
      .group("Tuning");
  EXPECT_EQ(program.flag("--share").description, "px, of the side");
  EXPECT_EQ(program.flag("--depth").description, "of it");
  EXPECT_EQ(program.flag("--depth").range->text(), "0..1");
  EXPECT_EQ(program.error({"--depth=1"}), "");
}

TEST(Bind, RefusesFieldsWithoutAFlag) {
  Program program;
  const int other = 0;
  EXPECT_THROW(bind_field(program.verb, program.options, program.options.inner),
               std::invalid_argument);
  EXPECT_THROW(bind_field(program.verb, program.options, other), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::cli
