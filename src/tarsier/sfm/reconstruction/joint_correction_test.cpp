// SPDX-License-Identifier: MIT
#include "tarsier/sfm/reconstruction/joint_correction.h"

#include "tarsier/core/errors.h"
#include "tarsier/sfm/consistency/testing_row.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

constexpr int kRowImages = 10;
constexpr int kHalf = 5;

// `is_misplaced`: the second half is at another place.
Model row(bool is_misplaced) {
  return is_misplaced ? misplaced_row(kRowImages, kHalf) : row_of_images(kRowImages);
}

Model part_of_row(int begin, int end) {
  Model model = row(false);
  for (int i = 0; i < kRowImages; ++i) model.images[at(i)].registered = i >= begin && i < end;
  return model;
}

// Pairs of each image with the next two, 100 and 60 inliers, without those between the parts.
std::vector<Pair> pairs_of_parts() {
  std::vector<Pair> pairs;
  for (int i = 0; i < kRowImages; ++i)
    for (int next = i + 1; next <= i + 2 && next < kRowImages; ++next)
      if ((i < kHalf) == (next < kHalf))
        pairs.push_back(pair_of_poses(row(false), i, next, next == i + 1 ? 100 : 60));
  return pairs;
}

// A pair whose wrong matches agree with the misplaced half.
Pair wrong_pair_of(int first, int second, std::size_t inliers) {
  Pair pair = pair_of_poses(row(true), first, second, inliers);
  pair.view.inliers = shown_matches(inliers, 3);
  return pair;
}

Reconstruction made_of(std::vector<Model> models, const std::vector<Pair>& pairs, double trust) {
  Reconstruction made;
  for (const Model& model : models) made.shapes.push_back(shape_of(model, pairs));
  made.trust.assign(models.size(), trust);
  made.models = std::move(models);
  return made;
}

bool has_pair(const std::vector<Pair>& pairs, int first, int second) {
  for (const Pair& pair : pairs)
    if (pair.first == first && pair.second == second) return !pair.view.inliers.empty();
  return false;
}

// The true pairs (4, 5), (3, 5) and (4, 6) contradict the weak pairs (1, 7) and (2, 8), which
// misplace the second half.
class ReplacedJoint : public testing::Test {
 protected:
  ReplacedJoint() {
    pairs_.push_back(pair_of_poses(row(false), kHalf - 1, kHalf, 90));
    pairs_.push_back(pair_of_poses(row(false), kHalf - 2, kHalf, 60));
    pairs_.push_back(pair_of_poses(row(false), kHalf - 1, kHalf + 1, 60));
    pairs_.push_back(wrong_pair_of(1, 7, 60));
    pairs_.push_back(wrong_pair_of(2, 8, 60));
    made_ = made_of({row(true)}, pairs_, 0.9);
    made_.refused = {{.first = 4, .second = 5, .inliers = 90, .reason = "before"}};
  }

  MapPairs maps_to(std::vector<Model> models, double trust) {
    return [this, models = std::move(models), trust](const std::vector<Pair>& pairs) {
      ++calls_;
      EXPECT_TRUE(has_pair(pairs, 4, 5));
      EXPECT_FALSE(has_pair(pairs, 1, 7));
      EXPECT_TRUE(has_pair(pairs, 7, 8));
      return made_of(models, pairs, trust);
    };
  }

  std::vector<Pair> pairs_ = pairs_of_parts();
  Reconstruction made_;
  int calls_ = 0;
};

TEST_F(ReplacedJoint, PartMovesToItsPlace) {
  correct_joints(pairs_, maps_to({row(false)}, 0.9), made_);
  ASSERT_THAT(made_.log.back(), testing::EndsWith(": used"));
  EXPECT_EQ(calls_, 2);  // the second time with all pairs that agree
  EXPECT_DOUBLE_EQ(made_.models[0].images[9].pose.translation.x(), -9);
  ASSERT_EQ(made_.refused.size(), 2U);
  for (const RefusedPair& refused : made_.refused) {
    EXPECT_EQ(refused.second, refused.first + 6);
    EXPECT_EQ(refused.inliers, 60);
    EXPECT_THAT(refused.reason, testing::HasSubstr("stronger pairs"));
  }
}

TEST_F(ReplacedJoint, StaysWhereScoreFallsOrTheModelBreaks) {
  correct_joints(pairs_, maps_to({row(false)}, 0.4), made_);
  correct_joints(pairs_, maps_to({part_of_row(0, 5), part_of_row(5, 10)}, 0.75), made_);
  EXPECT_EQ(calls_, 2);
  EXPECT_NE(made_.models[0].images[9].pose.translation.x(), -9);
  ASSERT_EQ(made_.refused.size(), 1U);
  EXPECT_EQ(made_.refused[0].reason, "before");
  ASSERT_EQ(made_.log.size(), 2U);
  EXPECT_THAT(made_.log, testing::Each(testing::EndsWith("not used")));
}

TEST_F(ReplacedJoint, PartsNeedAHigherScore) {
  correct_joints(pairs_, maps_to({part_of_row(0, 5), part_of_row(5, 10)}, 1), made_);
  EXPECT_EQ(made_.models.size(), 2U);
  EXPECT_THAT(made_.log[0], testing::EndsWith(": used"));
}

TEST_F(ReplacedJoint, InterruptionKeepsTheModel) {
  const MapPairs interrupted = [](const std::vector<Pair>&) -> Reconstruction {
    throw Interrupted();
  };
  EXPECT_THROW(correct_joints(pairs_, interrupted, made_), Interrupted);
  EXPECT_EQ(made_.models.size(), 1U);
}

TEST(OpenedJoint, PartsOfHigherScoreReplaceTheWhole) {
  std::vector<Pair> pairs = pairs_of_parts();
  pairs.push_back(wrong_pair_of(1, 7, 50));
  int calls = 0;
  const auto maps_with = [&](double trust) -> MapPairs {
    return [&, trust](const std::vector<Pair>& some) {
      ++calls;
      EXPECT_FALSE(has_pair(some, 1, 7));
      EXPECT_TRUE(has_pair(some, 0, 1));
      EXPECT_TRUE(has_pair(some, 8, 9));
      return made_of({part_of_row(0, 5), part_of_row(5, 10)}, some, trust);
    };
  };
  Reconstruction made = made_of({row(true)}, pairs, 0.8);
  EXPECT_NEAR(made.shapes[0].weakest_joint, 0.5, 1e-9);
  EXPECT_THAT(made.shapes[0].weakest_part.size(), 5U);
  correct_joints(pairs, maps_with(0.2), made);
  EXPECT_EQ(made.models.size(), 1U);
  correct_joints(pairs, maps_with(0.8), made);
  EXPECT_EQ(made.models.size(), 2U);
  EXPECT_EQ(calls, 2);
  ASSERT_EQ(made.refused.size(), 1U);
  EXPECT_EQ(made.refused[0].first, 1);
  EXPECT_EQ(made.refused[0].second, 7);
}

TEST(OpenedJoint, FirmJointsStay) {
  const std::vector<Pair> pairs = [] {
    std::vector<Pair> all = pairs_of_parts();
    all.push_back(pair_of_poses(row(false), 4, 5, 100));
    return all;
  }();
  Reconstruction made = made_of({row(false)}, pairs, 0.9);
  correct_joints(
      pairs,
      [](const std::vector<Pair>&) -> Reconstruction {
        ADD_FAILURE() << "mapped again";
        return {};
      },
      made);
  EXPECT_TRUE(made.log.empty());
}

}  // namespace
}  // namespace tarsier::sfm
