// SPDX-License-Identifier: MIT
#include "tarsier/sfm/consistency/contradicted_joint.h"

#include "tarsier/sfm/consistency/testing_row.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

namespace tarsier::sfm {
namespace {

constexpr int kLineImages = 12;
constexpr int kPartBegin = 7;

Model line() { return row_of_images(kLineImages); }
Model line_with_misplaced_part() { return misplaced_row(kLineImages, kPartBegin); }

TEST(ContradictedJoint, StrongPairsContradictWeakOnes) {
  const Model model = line_with_misplaced_part();
  std::vector<Pair> pairs = pairs_of_row(kLineImages);
  pairs.push_back(pair_of_poses(model, 2, 8, 60));
  pairs.push_back(pair_of_poses(model, 2, 9, 50));
  const auto joint = contradicted_joint(model, pairs);
  ASSERT_TRUE(joint);
  EXPECT_EQ(pairs[joint->pair].first, kPartBegin - 1);
  EXPECT_EQ(pairs[joint->pair].second, kPartBegin);
  EXPECT_DOUBLE_EQ(joint->strength, 1);
  EXPECT_DOUBLE_EQ(joint->bottleneck, 0.6);
  EXPECT_THAT(joint->part, testing::ElementsAre(7, 8, 9, 10, 11));
  std::vector<std::pair<int, int>> replacing;
  for (const std::size_t k : joint->replacing)
    replacing.emplace_back(pairs[k].first, pairs[k].second);
  EXPECT_THAT(replacing,
              testing::UnorderedElementsAre(std::pair(6, 7), std::pair(5, 7), std::pair(6, 8)));
  EXPECT_NEAR(joint->excess, (1 - 0.6) + 2 * (0.8 - 0.6), 1e-12);
}

TEST(ContradictedJoint, OnlyPairsOfTheSameRotationReplaceIt) {
  const Model model = line_with_misplaced_part();
  std::vector<Pair> pairs = pairs_of_row(kLineImages);
  pairs.push_back(pair_of_poses(model, 2, 8, 60));
  Pair other = pair_of_poses(line(), 4, 9, 90);
  other.view.inliers = shown_matches(90, 3);
  other.view.second_from_first.rotation = geometry::rotation_by({0, -0.5, 0});
  pairs.push_back(other);
  const auto joint = contradicted_joint(model, pairs);
  ASSERT_TRUE(joint);
  EXPECT_THAT(joint->replacing, testing::Not(testing::Contains(pairs.size() - 1)));
  EXPECT_THAT(joint->replacing, testing::SizeIs(3));
}

TEST(ContradictedJoint, WeakerPairsContradictNothing) {
  const Model model = line();
  std::vector<Pair> pairs = pairs_of_row(kLineImages);
  EXPECT_FALSE(contradicted_joint(model, pairs));
  // As strong as the weakest of the pairs that connect its images.
  Pair wrong = pair_of_poses(line_with_misplaced_part(), 2, 8, 100);
  wrong.view.inliers = shown_matches(100, 3);
  pairs.push_back(wrong);
  EXPECT_FALSE(contradicted_joint(model, pairs));
}

TEST(ContradictedJoint, FewMatchesContradictNothing) {
  const Model model = line_with_misplaced_part();
  std::vector<Pair> pairs = pairs_of_row(kLineImages);
  pairs.push_back(pair_of_poses(model, 2, 8, 60));
  for (Pair& pair : pairs) pair.view.inliers = shown_matches(pair.view.inliers.size() / 4);
  EXPECT_FALSE(contradicted_joint(model, pairs));
}

TEST(ContradictedJoint, PartsThatNothingConnectsHaveNone) {
  EXPECT_FALSE(contradicted_joint(line_with_misplaced_part(), pairs_of_row(kLineImages)));
}

}  // namespace
}  // namespace tarsier::sfm
