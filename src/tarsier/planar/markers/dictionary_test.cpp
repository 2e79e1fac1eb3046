// SPDX-License-Identifier: MIT
#include "tarsier/planar/markers/dictionary.h"

#include "tarsier/core/errors.h"

#include <gtest/gtest.h>

namespace tarsier::planar::markers {
namespace {

TEST(Dictionary, MatchesEveryCodeInEveryRotation) {
  for (const std::string& name : dictionary_names()) {
    const Dictionary& dictionary = find_dictionary(name);
    for (int id = 0; id < dictionary.size(); id += 7) {
      Code code = dictionary.code(id);
      for (int turn = 0; turn < 4; ++turn) {
        const auto match = dictionary.match(code, 0);
        ASSERT_TRUE(match) << name << ' ' << id << ' ' << turn;
        EXPECT_EQ(match->id, id) << name;
        EXPECT_EQ(match->rotation, turn) << name;
        code = rotated_clockwise(code, dictionary.cells());
      }
      EXPECT_EQ(code, dictionary.code(id));
    }
  }
}

TEST(Dictionary, HasPublishedDistances) {
  EXPECT_EQ(find_dictionary("16h5").distance(), 5);
  EXPECT_EQ(find_dictionary("25h9").distance(), 9);
  EXPECT_EQ(find_dictionary("36h10").distance(), 10);
  EXPECT_EQ(find_dictionary("36h11").distance(), 11);
  EXPECT_EQ(find_dictionary("aruco-original").size(), 1024);
  EXPECT_EQ(find_dictionary("36h11").size(), 587);
  EXPECT_EQ(find_dictionary("orig").cells(), 5);
}

TEST(Dictionary, CorrectsWrongCellsUpToHalfTheDistance) {
  const Dictionary& dictionary = find_dictionary("36h11");
  EXPECT_EQ(dictionary.correctable(), 5);
  const Code wrong = dictionary.code(100) ^ 0x801041020ULL;
  EXPECT_FALSE(dictionary.match(wrong, 4));
  const auto match = dictionary.match(wrong, 5);
  ASSERT_TRUE(match);
  EXPECT_EQ(match->id, 100);
  EXPECT_EQ(match->errors, 5);
}

TEST(Dictionary, IgnoresUnknownCellsAndRejectsTies) {
  const Dictionary dictionary("own", 3, {0b100'000'000, 0b110'010'000});
  // No bit is known: all markers are equal.
  EXPECT_FALSE(dictionary.match(0b100'000'000, 1, 0b111'111'111));
  const auto match = dictionary.match(0b111'010'000, 0, 0b001'000'000);
  ASSERT_TRUE(match);
  EXPECT_EQ(match->id, 1);
}

TEST(Dictionary, RejectsUnknownNamesAndIds) {
  EXPECT_THROW((void)find_dictionary("8x8"), UsageError);
  EXPECT_THROW((void)find_dictionary(""), UsageError);
  EXPECT_THROW((void)find_dictionary("36h11").code(587), std::invalid_argument);
  EXPECT_THROW((void)find_dictionary("36h11").code(-1), std::invalid_argument);
  EXPECT_THROW(Dictionary("own", 3, {512}), std::invalid_argument);
  EXPECT_THROW(Dictionary("own", 3, {}), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::planar::markers
