// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/model_shape.h"

#include "tarsier/sfm/consistency/testing_row.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

namespace tarsier::sfm {
namespace {

// A pair with the row's relative pose.
Pair pair_of(int first, int second, std::size_t inliers) {
  Pair pair;
  pair.first = first;
  pair.second = second;
  pair.view.inliers = shown_matches(inliers);
  pair.view.median_angle = 0.1;
  pair.view.second_from_first.translation = {first < second ? -1.0 : 1.0, 0, 0};
  return pair;
}

// Pairs of each image with the next two.
std::vector<Pair> neighbours(int images, std::size_t inliers_of_second) {
  std::vector<Pair> pairs;
  for (int i = 0; i + 1 < images; ++i) {
    pairs.push_back(pair_of(i, i + 1, 100));
    if (i + 2 < images) pairs.push_back(pair_of(i, i + 2, inliers_of_second));
  }
  return pairs;
}

void turn_from(int image, double degrees, Model& model) {
  const double angle = degrees * CV_PI / 180;
  for (auto i = static_cast<std::size_t>(image); i < model.images.size(); ++i)
    model.images[i].pose =
        geometry::Rigid3{geometry::rotation_by({0, angle, 0}), {0, 0, 0}} * model.images[i].pose;
}

TEST(ModelShape, MissesStrongPairsOfSlightlyRotatedPart) {
  const std::vector<Pair> pairs = neighbours(12, 90);
  Model model = row_of_images(12);
  EXPECT_THAT(shape_of(model, pairs).missed_pairs, testing::IsEmpty());
  turn_from(6, 10, model);
  const ModelShape shape = shape_of(model, pairs);
  ASSERT_EQ(shape.missed_pairs.size(), 3U);
  for (const ModelShape::MissedPair& missed : shape.missed_pairs) {
    EXPECT_LT(pairs[missed.pair].first, 6);
    EXPECT_GE(pairs[missed.pair].second, 6);
    EXPECT_GE(missed.strength, 0.9);
  }
  EXPECT_TRUE(is_unreliable(shape));
}

// A ring of 40 images that does not close: each rotation is slightly too large or too small.
TEST(ModelShape, MissesWeakPairsThatCloseLoop) {
  const auto ring = [](double degrees) {
    Model model;
    model.images.resize(40);
    for (std::size_t i = 0; i < 40; ++i) {
      const double angle = static_cast<double>(i) * degrees * CV_PI / 180;
      model.images[i].registered = true;
      model.images[i].pose = {geometry::rotation_by({0, angle, 0}), {0, 0, 1}};
    }
    return model;
  };
  Model truth = ring(9);
  show_points(truth, {0, 0, 0}, 0.3);
  std::vector<Pair> pairs;
  for (int i = 0; i < 40; ++i) {
    for (int step = 1; step <= 2; ++step) {
      Pair pair = pair_of(i, (i + step) % 40, i + step < 40 ? 100 : 35);
      const auto pose = [&](int k) { return truth.images[static_cast<std::size_t>(k)].pose; };
      pair.view.second_from_first = pose(pair.second) * pose(pair.first).inverse();
      pairs.push_back(pair);
    }
  }
  EXPECT_THAT(shape_of(truth, pairs).missed_pairs, testing::IsEmpty());
  Model open = ring(9.5);
  open.cameras = truth.cameras;
  for (std::size_t i = 0; i < open.images.size(); ++i)
    open.images[i].features = truth.images[i].features;
  const ModelShape shape = shape_of(open, pairs);
  ASSERT_EQ(shape.missed_pairs.size(), 3U);
  for (const ModelShape::MissedPair& missed : shape.missed_pairs) {
    EXPECT_TRUE(missed.closes_loop);
    EXPECT_NEAR(missed.strength, 0.35, 1e-9);
  }
  EXPECT_TRUE(is_unreliable(shape));
  EXPECT_EQ(shape_trust(shape), kUnreliableTrustFactor * std::min(1.0, shape.weakest_joint / 2));
}

TEST(ModelShape, IgnoresPairsOfDistantPlaces) {
  std::vector<Pair> pairs = neighbours(20, 90);
  Pair far = pair_of(0, 19, 100);  // the two images look alike
  far.view.second_from_first.translation = {1, 0, 0};
  far.view.inliers = shown_matches(100, 3);
  pairs.push_back(far);
  EXPECT_THAT(shape_of(row_of_images(20), pairs).missed_pairs, testing::IsEmpty());
  Pair behind = pair_of(3, 5, 100);  // two opposite sides that look alike
  behind.view.second_from_first.rotation = geometry::rotation_by({0, CV_PI / 2, 0});
  behind.view.inliers = shown_matches(100, 3);
  pairs.push_back(behind);
  // A weak pair beside pairs that agree has little weight.
  Pair weak = pair_of(10, 12, 60);
  weak.view.second_from_first.rotation = geometry::rotation_by({0, 0.3, 0});
  weak.view.inliers = shown_matches(60, 3);
  pairs.push_back(weak);
  EXPECT_THAT(shape_of(row_of_images(20), pairs).missed_pairs, testing::IsEmpty());
  weak.view.inliers = shown_matches(80, 3);
  pairs.push_back(weak);
  EXPECT_EQ(shape_of(row_of_images(20), pairs).missed_pairs.size(), 1U);
}

TEST(ModelShape, WeakestJointIsSumOfConnectingStrengths) {
  std::vector<Pair> pairs;
  for (const int from : {0, 5})
    for (int i = from; i < from + 5; ++i)
      for (int k = i + 1; k < from + 5; ++k) pairs.push_back(pair_of(i, k, 100));
  EXPECT_EQ(shape_of(row_of_images(10), pairs).weakest_joint, 0);  // no pair connects them
  pairs.push_back(pair_of(4, 5, 30));
  EXPECT_NEAR(shape_of(row_of_images(10), pairs).weakest_joint, 0.3, 1e-9);
  pairs.push_back(pair_of(3, 6, 40));
  const ModelShape shape = shape_of(row_of_images(10), pairs);
  EXPECT_NEAR(shape.weakest_joint, 0.7, 1e-9);
  EXPECT_NEAR(shape_trust(shape), 0.35, 1e-9);
  // Two images are too few to count as a part.
  const std::vector<Pair> few{pair_of(0, 1, 100), pair_of(1, 2, 100), pair_of(2, 3, 30),
                              pair_of(3, 4, 100)};
  EXPECT_TRUE(std::isinf(shape_of(row_of_images(5), few).weakest_joint));
  EXPECT_EQ(shape_trust(shape_of(row_of_images(5), few)), 1);
}

TEST(ModelShape, WellConnectedRowHasFullTrust) {
  const ModelShape shape = shape_of(row_of_images(30), neighbours(30, 60));
  EXPECT_NEAR(shape.weakest_joint, 1 + 2 * 0.6, 1e-9);
  EXPECT_EQ(shape_trust(shape), 1);
}

}  // namespace
}  // namespace tarsier::sfm
