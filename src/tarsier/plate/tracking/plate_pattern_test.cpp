// SPDX-License-Identifier: MIT
#include "tarsier/plate/tracking/plate_pattern.h"

#include "tarsier/core/errors.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace tarsier::plate {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

TEST(PatternTest, MatchesWildcardsAndOneEdit) {
  EXPECT_TRUE(matches("1234BCD", "1234BCD", false));
  EXPECT_FALSE(matches("1234BCD", "1234BCF", false));
  EXPECT_TRUE(matches("12?4*", "1284XYZ", false));
  EXPECT_FALSE(matches("12?4*", "1285XYZ", false));
  EXPECT_FALSE(matches("12?4", "12?45", false));
  EXPECT_TRUE(matches("*CD", "1234BCD", false));
  EXPECT_TRUE(matches("*", "", false));
  EXPECT_FALSE(matches("?", "", false));
  EXPECT_TRUE(matches("1*4*D", "1234BCD", false));

  EXPECT_TRUE(matches("1234BCD", "1284BCD", true));   // one character replaced
  EXPECT_TRUE(matches("1234BCD", "134BCD", true));    // one character missing
  EXPECT_TRUE(matches("1234BCD", "X1234BCD", true));  // one character too many
  EXPECT_FALSE(matches("1234BCD", "1284BCX", true));
  EXPECT_TRUE(matches("1204BCD", "I2O4BC0", true));  // all look-alikes are folded
  EXPECT_TRUE(matches("1204BCD", "I2O4BX0", true));  // and one more difference
  EXPECT_TRUE(matches("12?4*", "1285XYZ", true));
  EXPECT_FALSE(matches("12?4*", "1985XYZ", true));
}

TEST(PatternTest, ParsesUserInput) {
  EXPECT_EQ(plate_pattern("b-12?4 *"), "B12?4*");
  for (const char* text : {"", " - ", "B%", "x;y", "\xC3\x91"}) {
    EXPECT_THROW((void)plate_pattern(text), UsageError) << text;
  }
  EXPECT_THROW((void)plate_pattern(std::string(100, '*')), UsageError);
}

TEST(PatternTest, PiecesOccurInMatchingTexts) {
  EXPECT_THAT(trigrams_of("1234BC"), ElementsAre("123", "234", "34B", "4BC", "BC$"));
  EXPECT_THAT(required_pieces("1234BC"), ElementsAre("123", "4BC"));
  EXPECT_THAT(required_pieces("*4BC?"), ElementsAre("4BC"));
  EXPECT_THAT(required_pieces("*4B*"), ElementsAre("4B"));
  EXPECT_THAT(required_pieces("?"), IsEmpty());
  EXPECT_THAT(near_match_pieces("1234BC"), ElementsAre("123", "4BC"));
  EXPECT_THAT(near_match_pieces("1234"), ElementsAre("12", "34$"));
  EXPECT_THAT(near_match_pieces("12"), IsEmpty());
}

}  // namespace
}  // namespace tarsier::plate
