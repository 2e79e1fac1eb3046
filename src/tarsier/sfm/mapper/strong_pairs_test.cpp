// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/strong_pairs.h"

#include <gtest/gtest.h>

namespace tarsier::sfm {
namespace {

Pair pair_of(int first, int second, std::size_t inliers) {
  Pair pair;
  pair.first = first;
  pair.second = second;
  pair.view.inliers.resize(inliers);
  pair.view.second_from_first.translation = {1, 0, 0};
  pair.view.median_angle = 0.1;
  return pair;
}

TEST(StrongPairs, AreThoseOfMostInliersOfEitherImage) {
  const std::vector<Pair> pairs{pair_of(0, 1, 100), pair_of(1, 2, 79), pair_of(2, 3, 80),
                                pair_of(0, 3, 63), pair_of(3, 4, 20)};
  const std::vector<Pair> strong = strong_pairs(pairs, 5, 0.8);
  ASSERT_EQ(strong.size(), 5U);
  EXPECT_EQ(strong[0].view.inliers.size(), 100U);
  EXPECT_EQ(strong[1].view.inliers.size(), 79U);  // next to the most of image 2
  EXPECT_EQ(strong[2].view.inliers.size(), 80U);
  EXPECT_EQ(strong[3].view.inliers.size(), 0U);   // weak for 0 and for 3
  EXPECT_EQ(strong[4].view.inliers.size(), 20U);  // all that image 4 has
}

TEST(StrongPairs, PairsThatTheModelContradictsHaveNoInliers) {
  Model model;
  model.images.resize(4);
  for (std::size_t i = 0; i < 3; ++i) {
    model.images[i].registered = true;
    model.images[i].pose.translation = {static_cast<double>(i), 0, 0};
  }
  Pair wrong = pair_of(0, 2, 50);
  wrong.view.second_from_first.translation = {-1, 0, 0};
  const std::vector<Pair> pairs{pair_of(0, 1, 50), wrong, pair_of(2, 3, 50), pair_of(1, 2, 50)};
  const std::vector<Pair> left = without_contradicted(pairs, {model});
  EXPECT_EQ(left[0].view.inliers.size(), 50U);
  EXPECT_EQ(left[1].view.inliers.size(), 0U);
  EXPECT_EQ(left[2].view.inliers.size(), 50U);  // image 3 is in no model
  std::vector<Pair> some = pairs;
  for (std::size_t k = 1; k < some.size(); ++k) some[k].view.inliers.clear();
  const std::vector<Pair> supported = with_supported(some, pairs, {model});
  EXPECT_EQ(supported[0].view.inliers.size(), 50U);
  EXPECT_EQ(supported[1].view.inliers.size(), 0U);
  EXPECT_EQ(supported[2].view.inliers.size(), 0U);
  EXPECT_EQ(supported[3].view.inliers.size(), 50U);
}

}  // namespace
}  // namespace tarsier::sfm
