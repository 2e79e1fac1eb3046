// SPDX-License-Identifier: MIT
#include "tarsier/sfm/reconstruction/all_pairs.h"

#include "tarsier/core/errors.h"
#include "tarsier/sfm/consistency/model_conflicts.h"
#include "tarsier/sfm/consistency/testing_prism.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <set>
#include <stop_token>
#include <vector>

namespace tarsier::sfm {
namespace {

using test_support::kPrismImages;
using test_support::kPrismSide;

// A prism, and its reconstruction from the pairs within the same side only.
struct Scene {
  explicit Scene(bool folded) : prism(test_support::prism(folded)), colors(kPrismImages) {
    for (std::size_t i = 0; i < colors.size(); ++i)
      colors[i].resize(prism.model.images[i].features.size());
    std::vector<const Pair*> of_one_side;
    for (const Pair& pair : prism.pairs)
      if (pair.first / kPrismSide == pair.second / kPrismSide) of_one_side.push_back(&pair);
    made.models.push_back(retriangulated(prism.model, of_one_side, input(), options));
    made.trust = {1};
    made.outcomes.assign(kPrismImages, {true, 0, 1, ""});
  }
  MapperInput input() const {
    return {.cameras = prism.model.cameras,
            .images = prism.model.images,
            .colors = colors,
            .descriptors = descriptors,
            .pairs = prism.pairs};
  }
  test_support::Prism prism;
  std::vector<std::vector<cv::Vec3b>> colors;
  std::vector<cv::Mat> descriptors;
  MapperOptions options;
  Reconstruction made;
};

// Points that are observed by images of several sides.
int between_sides(const Model& model) {
  int count = 0;
  for (const Point& point : model.points) {
    std::set<int> sides;
    for (const Observation& seen : point.track) sides.insert(seen.image / kPrismSide);
    count += sides.size() > 1 ? 1 : 0;
  }
  return count;
}

TEST(TrustByAllPairs, IsLowForFoldedModelWithoutConflicts) {
  Scene scene(true);
  EXPECT_FALSE(ModelConflicts(scene.made.models[0]).any());
  update_trust_by_all_pairs(scene.input(), scene.options, {}, scene.made);
  EXPECT_LT(scene.made.trust[0], 0.3);
  EXPECT_LT(scene.made.outcomes[0].trust, 0.3);
}

TEST(TrustByAllPairs, IsHighForCorrectModel) {
  Scene scene(false);
  update_trust_by_all_pairs(scene.input(), scene.options, {}, scene.made);
  EXPECT_GT(scene.made.trust[0], 0.95);
}

TEST(TrustByAllPairs, FallsWherePairsRefusedForMissingFeaturesAgree) {
  Scene scene(false);
  for (const Pair& pair : scene.prism.pairs)
    if (pair.first == 5 || pair.second == 5)
      scene.made.refused.push_back(
          {pair.first, pair.second, 50, "", PairRejection::kMissingFeatures});
  update_trust_by_all_pairs(scene.input(), scene.options, {}, scene.made);
  EXPECT_EQ(scene.made.outcomes[5].trust, 0);
  EXPECT_GT(scene.made.outcomes[40].trust, 0.9);
}

TEST(TrustByAllPairs, IsUnchangedWhenInterrupted) {
  Scene scene(true);
  std::stop_source stopped;
  stopped.request_stop();
  EXPECT_THROW(
      update_trust_by_all_pairs(scene.input(), scene.options, stopped.get_token(), scene.made),
      Interrupted);
  EXPECT_EQ(scene.made.trust[0], 1);
}

TEST(Retriangulated, TriangulatesPointsOfGivenPairsOnly) {
  const Scene scene(false);
  const Model none = retriangulated(scene.prism.model, {}, scene.input(), scene.options);
  EXPECT_TRUE(none.points.empty());
  EXPECT_TRUE(none.images[3].registered);
  std::vector<const Pair*> all;
  for (const Pair& pair : scene.prism.pairs) all.push_back(&pair);
  const Model made = retriangulated(scene.prism.model, all, scene.input(), scene.options);
  EXPECT_EQ(between_sides(scene.made.models[0]), 0);
  EXPECT_GT(between_sides(made), 50);
  EXPECT_EQ(made.images[3].pose.translation, scene.prism.model.images[3].pose.translation);
}

}  // namespace
}  // namespace tarsier::sfm
