// SPDX-License-Identifier: MIT
#include "tarsier/sfm/mapper/contradicted_images.h"

#include "tarsier/core/at.h"
#include "tarsier/sfm/consistency/testing_prism.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace tarsier::sfm {
namespace {

using test_support::kPrismImages;
using test_support::Prism;

constexpr int kImage = 5;

void link_points(Model& model) {
  for (Image& image : model.images) image.points.assign(image.features.size(), -1);
  for (std::size_t p = 0; p < model.points.size(); ++p)
    for (const Observation& seen : model.points[p].track)
      model.images[at(seen.image)].points[at(seen.feature)] = static_cast<int>(p);
}

// A prism in which one image observes only `points` points; `misplaced`: with the pose of an image
// on the opposite side.
Prism prism_with_image(int points, bool misplaced) {
  Prism prism = test_support::prism(false);
  Model& model = prism.model;
  int kept = 0;
  for (Point& point : model.points) {
    std::erase_if(point.track,
                  [&](const Observation& seen) { return seen.image == kImage && ++kept > points; });
  }
  if (misplaced) model.images[kImage].pose = model.images[kImage + kPrismImages / 2].pose;
  link_points(model);
  return prism;
}

// Leaves only the first images of a model.
void keep_first(int images, Prism& prism) {
  for (std::size_t i = at(images); i < prism.model.images.size(); ++i)
    prism.model.images[i].registered = false;
  for (Point& point : prism.model.points)
    std::erase_if(point.track, [&](const Observation& seen) { return seen.image >= images; });
  std::erase_if(prism.model.points, [](const Point& point) { return point.track.size() < 2; });
  link_points(prism.model);
}

TEST(ContradictedImages, ImageAtAWrongPlaceIsRemovedWithItsObservations) {
  Prism prism = prism_with_image(30, true);
  const auto removed = remove_contradicted_images(prism.pairs, prism.model);
  ASSERT_EQ(removed.size(), 1U);
  EXPECT_EQ(removed[0].image, kImage);
  EXPECT_EQ(removed[0].points, 30);
  EXPECT_LT(2 * removed[0].explained, removed[0].inliers);
  EXPECT_FALSE(prism.model.images[kImage].registered);
  EXPECT_TRUE(prism.model.images[kImage].features.empty());
  for (std::size_t p = 0; p < prism.model.points.size(); ++p) {
    ASSERT_GE(prism.model.points[p].track.size(), 2U);
    for (const Observation& seen : prism.model.points[p].track) {
      ASSERT_NE(seen.image, kImage);
      EXPECT_EQ(prism.model.images[at(seen.image)].points[at(seen.feature)], static_cast<int>(p));
    }
  }
}

TEST(ContradictedImages, ImageWithFewPointsStaysWhereItsPairsAgree) {
  Prism prism = prism_with_image(30, false);
  EXPECT_TRUE(remove_contradicted_images(prism.pairs, prism.model).empty());
  EXPECT_TRUE(prism.model.images[kImage].registered);
}

TEST(ContradictedImages, ImageWithManyPointsStays) {
  Prism prism = prism_with_image(60, true);
  EXPECT_TRUE(remove_contradicted_images(prism.pairs, prism.model).empty());
}

TEST(ContradictedImages, SmallModelIsNotChanged) {
  Prism prism = prism_with_image(30, true);
  keep_first(8, prism);
  EXPECT_TRUE(remove_contradicted_images(prism.pairs, prism.model).empty());
  keep_first(8, prism);
  EXPECT_TRUE(prism.model.images[kImage].registered);
}

TEST(ContradictedImages, OutcomesAndOrderOfModelsFollow) {
  // Nine images of the prism, one of them misplaced, and eight others.
  Prism first = prism_with_image(30, true);
  keep_first(9, first);
  Reconstruction made;
  made.models = {first.model, test_support::prism(false).model};
  for (int i = 0; i < kPrismImages; ++i)
    made.models[1].images[at(i)].registered = i >= 20 && i < 29;
  made.models[1].points.clear();
  link_points(made.models[1]);
  made.outcomes.resize(kPrismImages);
  for (int i = 0; i < kPrismImages; ++i) {
    if (i < 9) made.outcomes[at(i)] = {.registered = true, .model = 0, .trust = 0.5, .reason = {}};
    if (i >= 20 && i < 29)
      made.outcomes[at(i)] = {.registered = true, .model = 1, .trust = 0.9, .reason = {}};
  }
  made.outcomes[kImage].trust = 0.1;
  made.trust = {0.4, 0.9};
  made.shapes.resize(2);
  // Pairs of the second model would contradict it, as it has no points.
  std::vector<Pair> pairs;
  for (const Pair& pair : first.pairs)
    if (pair.first < 9 && pair.second < 9) pairs.push_back(pair);
  remove_contradicted_images(pairs, made);
  ASSERT_EQ(made.models.size(), 2U);
  EXPECT_FALSE(made.models[0].images[0].registered);  // now the second of size 8
  EXPECT_EQ(made.outcomes[0].model, 1);
  EXPECT_EQ(made.outcomes[20].model, 0);
  EXPECT_THAT(made.trust, ::testing::ElementsAre(0.9, 0.4));
  EXPECT_FALSE(made.outcomes[kImage].registered);
  EXPECT_THAT(made.outcomes[kImage].reason, ::testing::HasSubstr("30 points"));
  EXPECT_THAT(made.log, ::testing::ElementsAre(::testing::HasSubstr("1 of 9 images are removed")));
}

}  // namespace
}  // namespace tarsier::sfm
