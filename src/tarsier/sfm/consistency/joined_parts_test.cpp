// SPDX-License-Identifier: MIT
#include "tarsier/sfm/consistency/joined_parts.h"

#include "tarsier/core/at.h"
#include "tarsier/sfm/consistency/testing_row.h"

#include <gtest/gtest.h>

#include <vector>

namespace tarsier::sfm {
namespace {

constexpr int kRowImages = 12;
constexpr int kSecondBegin = 7;

// The images from `begin` to `end` of a model.
Model part_of(Model model, int begin, int end) {
  for (int i = 0; i < kRowImages; ++i)
    if (i < begin || i >= end) model.images[at(i)].registered = false;
  return model;
}

std::vector<Model> two_parts() {
  const Model row = row_of_images(kRowImages);
  return {part_of(row, 0, kSecondBegin), part_of(row, kSecondBegin, kRowImages)};
}

TEST(JoinedParts, WholeJoinsItsParts) {
  const Model row = row_of_images(kRowImages);
  EXPECT_TRUE(joins_parts({row}, two_parts(), pairs_of_row(kRowImages)));
  // A part of two images has no shape, and one image may be missing in twenty only.
  EXPECT_TRUE(joins_parts({row}, {two_parts()[0], part_of(row, 8, 10)}, pairs_of_row(kRowImages)));
  EXPECT_FALSE(
      joins_parts({part_of(row, 0, kRowImages - 1)}, two_parts(), pairs_of_row(kRowImages)));
  EXPECT_FALSE(joins_parts(two_parts(), two_parts(), pairs_of_row(kRowImages)));
  EXPECT_FALSE(joins_parts({}, two_parts(), pairs_of_row(kRowImages)));
}

TEST(JoinedParts, OnlyStrongerContradictedPairsMatter) {
  const Model row = row_of_images(kRowImages);
  const auto joins_despite_pair_of = [&](std::size_t inliers) {
    std::vector<Pair> pairs = pairs_of_row(kRowImages);
    for (Pair& pair : pairs)
      if (pair.first < kSecondBegin && pair.second >= kSecondBegin)
        pair.view.inliers = shown_matches(80);
    Pair wrong = pair_of_poses(misplaced_row(kRowImages, kSecondBegin), 2, 8, inliers);
    wrong.view.inliers = shown_matches(inliers, 3);
    pairs.push_back(wrong);
    return joins_parts({row}, two_parts(), pairs);
  };
  EXPECT_TRUE(joins_despite_pair_of(75));
  EXPECT_FALSE(joins_despite_pair_of(85));
}

TEST(JoinedParts, MisplacedPartIsContradictedByStrongerPairs) {
  const Model misplaced = misplaced_row(kRowImages, kSecondBegin);
  std::vector<Pair> pairs = pairs_of_row(kRowImages);
  pairs.push_back(pair_of_poses(misplaced, 2, 8, 60));
  EXPECT_FALSE(joins_parts({misplaced}, two_parts(), pairs));
}

TEST(JoinedParts, NeedsPairsBetweenTheParts) {
  const Model row = row_of_images(kRowImages);
  std::vector<Pair> pairs = pairs_of_row(kRowImages);
  std::erase_if(pairs, [](const Pair& pair) {
    return pair.first < kSecondBegin && pair.second >= kSecondBegin;
  });
  EXPECT_FALSE(joins_parts({row}, two_parts(), pairs));
}

TEST(JoinedParts, PartsKeepTheirShape) {
  Model bent = row_of_images(kRowImages);
  for (int i = 4; i < kSecondBegin; ++i)
    bent.images[at(i)].pose.translation += Eigen::Vector3d(0, 0.5, 0);
  EXPECT_FALSE(joins_parts({bent}, two_parts(), pairs_of_row(kRowImages)));
}

}  // namespace
}  // namespace tarsier::sfm
