// SPDX-License-Identifier: MIT
#include "tarsier/core/name_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tarsier {
namespace {

enum class Fruit { kApple, kPear, kPlum };
constexpr NameTable<Fruit, 2> kFruits{"fruit",
                                      {{{Fruit::kApple, "apple"}, {Fruit::kPear, "pear"}}}};

TEST(NameTable, NamesAndValuesRoundTrip) {
  for (const Fruit fruit : {Fruit::kApple, Fruit::kPear})
    EXPECT_EQ(kFruits.parse(kFruits.name(fruit)), fruit);
  EXPECT_EQ(kFruits.name(Fruit::kPlum), "") << "a value without a name";
  EXPECT_EQ(kFruits.find("plum"), std::nullopt);
  EXPECT_THAT(kFruits.choices(), testing::ElementsAre("apple", "pear"));
}

TEST(NameTable, UnknownNamesListTheKnownOnes) {
  try {
    (void)kFruits.parse("plum\n");
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "unknown fruit 'plum\\n': apple or pear");
  }
  EXPECT_EQ(unknown_name("mode", "x", {"a", "b", "c"}), "unknown mode 'x': a, b or c");
}

}  // namespace
}  // namespace tarsier
