// SPDX-License-Identifier: MIT
#include "tarsier/plate/text/reading.h"

#include "tarsier/core/errors.h"
#include "tarsier/plate/text/symbol_labels.h"
#include "tarsier/plate/text/text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>
#include <stdexcept>
#include <string>

namespace tarsier::plate {
namespace {

TEST(ReadingTest, ClassOfMapsExactlyTheAlphabet) {
  for (std::size_t k = 0; k < kAlphabet.size(); ++k) {
    EXPECT_EQ(class_of(kAlphabet[k]), static_cast<int>(k));
  }
  for (const char other : {'a', ' ', '-', '@', '[', '/', ':', '\0', '\xC3'}) {
    EXPECT_EQ(class_of(other), -1) << static_cast<int>(other);
  }
}

TEST(ReadingTest, BoundingBoxCoversTheQuadAndIsClipped) {
  const Quad quad{cv::Point2f{10, 5}, {20, 3}, {21, 8}, {11, 10}};
  EXPECT_EQ(bounding_box(quad, {100, 50}), cv::Rect(10, 3, 12, 8));
  EXPECT_EQ(bounding_box(quad, {15, 6}), cv::Rect(10, 3, 5, 3));
  const Quad outside{cv::Point2f{-10, -5}, {-3, -5}, {-3, -1}, {-10, -1}};
  EXPECT_TRUE(bounding_box(outside, {100, 50}).empty());
  const Quad huge{cv::Point2f{-1e30F, -1e30F}, {1e30F, -1e30F}, {1e30F, 1e30F}, {-1e30F, 1e30F}};
  EXPECT_EQ(bounding_box(huge, {100, 50}), cv::Rect(0, 0, 100, 50));
  Quad broken = quad;
  broken[2].x = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW((void)bounding_box(broken, {100, 50}), std::invalid_argument);
}

TEST(SymbolLabels, ParsesLinesAndSkipsBlankOnes) {
  const auto labels =
      parse_symbol_labels("3 0.25 0.5 0.1 0.8\n\r\n \t35 -0.5 1 1.5 0.01 7\r\n", "x.txt");
  ASSERT_EQ(labels.size(), 2u);
  EXPECT_EQ(labels[0].class_id, 3);
  EXPECT_EQ(labels[0].x, 0.25);
  EXPECT_EQ(labels[0].h, 0.8);
  EXPECT_EQ(labels[1].class_id, 35);
  EXPECT_EQ(labels[1].x, -0.5);
}

TEST(SymbolLabels, ErrorNamesTheLine) {
  for (const char* line :
       {"36 0.5 0.5 0.1 0.1", "-1 0.5 0.5 0.1 0.1", "3 0.5 0.5 0.1", "A 0.5 0.5 0.1 0.1",
        "3 0.5 0.5 0 0.1", "3 0.5 nan 0.1 0.1", "3 2 0.5 0.1 0.1", "3 0.5 0.5 0.1 1e400"}) {
    try {
      (void)parse_symbol_labels(std::string("1 0.5 0.5 0.1 0.1\n") + line, "plate.txt");
      ADD_FAILURE() << line;
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), testing::HasSubstr("plate.txt: line 2")) << line;
    }
  }
}

TEST(TextTest, EditDistanceCountsEdits) {
  EXPECT_EQ(edit_distance("1234BCD", "1234BCD"), 0);
  EXPECT_EQ(edit_distance("1234BCD", "1284BCD"), 1);
  EXPECT_EQ(edit_distance("1234BCD", "234BCD"), 1);
  EXPECT_EQ(edit_distance("234BCD", "E1234BCD"), 2);
  EXPECT_EQ(edit_distance("", "ABC"), 3);
  EXPECT_EQ(edit_distance("ABC", ""), 3);
  EXPECT_EQ(edit_distance("KITTEN", "SITTING"), 3);
}

TEST(TextTest, HiddenCharactersOfTheTruthCostNothing) {
  EXPECT_EQ(edit_distance_to_truth("12-4BCD", "1234BCD"), 0);
  EXPECT_EQ(edit_distance_to_truth("12-4BCD", "124BCD"), 0);
  EXPECT_EQ(edit_distance_to_truth("12-4BCD", "12994BCD"), 1);
  EXPECT_EQ(edit_distance_to_truth("--", ""), 0);
  EXPECT_EQ(edit_distance_to_truth("124", "1-24"), 1);
}

TEST(TextTest, PlateSymbolsDropsOtherCharacters) {
  EXPECT_EQ(plate_symbols("b-1234 xy"), "B1234XY");
  EXPECT_EQ(plate_symbols("b-1234 \xC3\x91", true), "B-1234");
  EXPECT_EQ(fold_symbols("DOQ0I1B8"), "000011B8");
}

}  // namespace
}  // namespace tarsier::plate
