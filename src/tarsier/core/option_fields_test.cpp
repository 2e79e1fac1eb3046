// SPDX-License-Identifier: MIT
#include "tarsier/core/option_fields.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

namespace tarsier {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

TEST(Range, Edges) {
  const double below_1 = std::nextafter(1.0, 0.0), above_0 = std::nextafter(0.0, 1.0);
  const double above_1 = std::nextafter(1.0, 2.0), below_0 = -above_0;
  EXPECT_TRUE(range(0, 1).contains(0) && range(0, 1).contains(1));
  EXPECT_FALSE(range(0, 1).contains(below_0) || range(0, 1).contains(above_1));
  EXPECT_TRUE(range_below(0, 1).contains(0) && range_below(0, 1).contains(below_1));
  EXPECT_FALSE(range_below(0, 1).contains(below_0) || range_below(0, 1).contains(1));
  EXPECT_TRUE(inside(0, 1).contains(above_0) && inside(0, 1).contains(below_1));
  EXPECT_FALSE(inside(0, 1).contains(0) || inside(0, 1).contains(1));
  EXPECT_TRUE(above(0, 1).contains(above_0) && above(0, 1).contains(1));
  EXPECT_FALSE(above(0, 1).contains(0) || above(0, 1).contains(above_1));
  EXPECT_TRUE(above(0).contains(above_0) && above(0).contains(1e300));
  EXPECT_FALSE(above(0).contains(0));
  EXPECT_TRUE(at_least(0).contains(0) && at_least(0).contains(1e300));
  EXPECT_FALSE(at_least(0).contains(below_0));
  EXPECT_TRUE(odd_range(3, 7).contains(3) && odd_range(3, 7).contains(7));
  EXPECT_FALSE(odd_range(3, 7).contains(4) || odd_range(3, 7).contains(1) ||
               odd_range(3, 7).contains(4.5));
  EXPECT_TRUE(odd_range(-3, 7).contains(-1));
}

TEST(Range, NeverHoldsNanOrInfinity) {
  for (const Range& any : {Range{}, range(0, 1), above(0), at_least(0), inside(0, 1)}) {
    for (const double value : {kNan, kInfinity, -kInfinity}) EXPECT_FALSE(any.contains(value));
  }
}

TEST(Range, Text) {
  EXPECT_EQ(range(0, 1).text(), "0..1");
  EXPECT_EQ(range(0.001, 1e6).text(), "0.001..1000000");
  EXPECT_EQ(range(1e-9, 0.5).text(), "1e-09..0.5");
  EXPECT_EQ(odd_range(3, 7).text(), "3..7, odd");
  EXPECT_EQ(above(0).text(), "> 0");
  EXPECT_EQ(at_least(2).text(), ">= 2");
  EXPECT_EQ(above(0, 255).text(), "> 0, <= 255");
  EXPECT_EQ(range_below(0, 1).text(), ">= 0, < 1");
  EXPECT_EQ(inside(0, 1).text(), "> 0, < 1");
  EXPECT_EQ(Range{}.text(), "");
}

TEST(UnitOf, IsTheFirstWordOfTheHelp) {
  EXPECT_EQ(unit_of("px, of the shortest side"), "px");
  EXPECT_EQ(unit_of("px"), "px");
  EXPECT_EQ(unit_of("s without a frame"), "s");
  EXPECT_EQ(unit_of("seconds between checkpoints"), "seconds");
  EXPECT_EQ(unit_of("grey levels that count as moved"), "grey levels");
  EXPECT_EQ(unit_of("side of a patch, px"), "");
  EXPECT_EQ(unit_of("share of change"), "");
  EXPECT_EQ(unit_of("min contrast"), "");
  EXPECT_EQ(unit_of(""), "");
}

// One field of every type.
struct Every {
  int integer = 7;
  unsigned natural = 1;
  std::int64_t large = 0;
  std::uint64_t seed = 1;
  float small = 0.5F;
  double number = 0.5;
  bool on = false;
  std::string text = "any";
  std::optional<int> maybe = {};
  std::optional<double> maybe_number = {};
  std::vector<int> sizes = {3, 5};
  std::vector<double> shares = {};
  double free = 0;

  [[nodiscard]] OptionFields fields() {
    return {{"integer", integer, range(6, 1000), "--integer", "px, how large"},
            {"natural", natural, range(1, 10)},
            {"large", large, at_least(0)},
            {"seed", seed, range(1, 1e9)},
            {"small", small, range(0, 1)},
            {"number", number, inside(0, 1), "--number", "a share"},
            {"on", on, "--on", "a switch"},
            {"text", text, "--text", "a text"},
            {"maybe", maybe, range(16, 64)},
            {"maybe_number", maybe_number, above(0)},
            {"sizes", sizes, odd_range(3, 7)},
            {"shares", shares, range(0, 1)},
            {"free", free, "--free", "any number"}};
  }
  void check() const { check_fields(*this); }
};

std::string problem(const Every& options) {
  try {
    options.check();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(CheckFields, NamesTheFieldItsValueAndItsRange) {
  EXPECT_EQ(problem({}), "");
  EXPECT_EQ(problem({.integer = 5}), "integer 5: expected 6..1000 px");
  EXPECT_EQ(problem({.integer = 1001}), "integer 1001: expected 6..1000 px");
  EXPECT_EQ(problem({.natural = 0}), "natural 0: expected 1..10");
  EXPECT_EQ(problem({.large = -1}), "large -1: expected >= 0");
  EXPECT_EQ(problem({.seed = 0}), "seed 0: expected 1..1000000000");
  EXPECT_EQ(problem({.small = 1.2F}), "small 1.2: expected 0..1");
  EXPECT_EQ(problem({.number = 1}), "number 1: expected > 0, < 1");
  EXPECT_EQ(problem({.number = kNan}), "number nan: expected > 0, < 1");
  EXPECT_EQ(problem({.sizes = {3, 4}}), "sizes 4: expected 3..7, odd");
  EXPECT_EQ(problem({.shares = {0.5, kInfinity}}), "shares inf: expected 0..1");
}

TEST(CheckFields, AnOptionalIsCheckedWhereItIsSet) {
  EXPECT_EQ(problem({.maybe = 16}), "");
  EXPECT_EQ(problem({.maybe = 15}), "maybe 15: expected 16..64");
  EXPECT_EQ(problem({.maybe_number = 0.0}), "maybe_number 0: expected > 0");
}

TEST(CheckFields, WithoutARangeEveryNumberIsAllowed) { EXPECT_EQ(problem({.free = kNan}), ""); }

}  // namespace
}  // namespace tarsier
