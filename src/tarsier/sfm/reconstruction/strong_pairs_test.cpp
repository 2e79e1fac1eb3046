// SPDX-License-Identifier: MIT
#include "tarsier/sfm/reconstruction/strong_pairs.h"

#include "tarsier/core/errors.h"
#include "tarsier/sfm/consistency/testing_row.h"

#include <gtest/gtest.h>

#include <functional>
#include <vector>

namespace tarsier::sfm {
namespace {

const PatchRejection kPatchesDiffer{"differ", true};

Pair verified_pair(int first, int second, std::size_t inliers) {
  Pair pair;
  pair.first = first;
  pair.second = second;
  pair.view.inliers = shown_matches(inliers);
  pair.view.second_from_first.translation = {1, 0, 0};
  pair.view.median_angle = 0.1;
  return pair;
}

// A pair with wrong matches and a rotation by `angle` radians.
Pair wrong_pair(int first, int second, std::size_t inliers, double angle) {
  Pair pair = verified_pair(first, second, inliers);
  pair.view.inliers = shown_matches(inliers, 3);
  pair.view.second_from_first.rotation = geometry::rotation_by({0, angle, 0});
  return pair;
}

TEST(StrongPairs, HaveMostInliersOfEitherImage) {
  const std::vector<Pair> pairs{verified_pair(0, 1, 100), verified_pair(1, 2, 79),
                                verified_pair(2, 3, 80), verified_pair(0, 3, 63),
                                verified_pair(3, 4, 20)};
  const std::vector<Pair> strong = strong_pairs(pairs, 5, 0.8);
  ASSERT_EQ(strong.size(), 5U);
  EXPECT_EQ(strong[0].view.inliers.size(), 100U);
  EXPECT_EQ(strong[1].view.inliers.size(), 79U);  // below image 2's best pair
  EXPECT_EQ(strong[2].view.inliers.size(), 80U);
  EXPECT_EQ(strong[3].view.inliers.size(), 0U);   // weak for images 0 and 3
  EXPECT_EQ(strong[4].view.inliers.size(), 20U);  // the best of image 4
}

TEST(StrongPairs, ContradictedPairsLoseTheirInliers) {
  Model model;
  model.images.resize(4);
  for (std::size_t i = 0; i < 3; ++i) {
    model.images[i].registered = true;
    model.images[i].pose.translation = {static_cast<double>(i), 0, 0};
  }
  show_points(model, {0, 0, 8}, 4);
  const Pair wrong = wrong_pair(0, 2, 50, CV_PI / 2);
  const std::vector<Pair> pairs{verified_pair(0, 1, 50), wrong, verified_pair(2, 3, 50),
                                verified_pair(1, 2, 50)};
  const std::vector<Pair> remaining = without_contradicted(pairs, {model});
  EXPECT_EQ(remaining[0].view.inliers.size(), 50U);
  EXPECT_EQ(remaining[1].view.inliers.size(), 0U);
  EXPECT_EQ(remaining[2].view.inliers.size(), 50U);  // image 3 is in no model
  // But if the contradiction is small, it may be accumulated drift.
  const Pair missed = wrong_pair(0, 2, 50, 0.3);
  const std::vector<Pair> with_missed{pairs[0], missed, pairs[3]};
  EXPECT_EQ(without_contradicted(with_missed, {model})[1].view.inliers.size(), 50U);
  std::vector<Pair> some = pairs;
  for (std::size_t k = 1; k < some.size(); ++k) some[k].view.inliers = {};
  const std::vector<Pair> supported = with_supported(some, pairs, {model});
  EXPECT_EQ(supported[0].view.inliers.size(), 50U);
  EXPECT_EQ(supported[1].view.inliers.size(), 0U);
  EXPECT_EQ(supported[2].view.inliers.size(), 0U);
  EXPECT_EQ(supported[3].view.inliers.size(), 50U);
}

// A mapper whose call k returns a model of trust `trusts[k]`, with all five images at one place on
// a line.
struct FakeMapper {
  std::vector<double> trusts;
  std::vector<std::vector<std::size_t>> calls;  // inlier counts of the pairs

  Reconstruction operator()(const std::vector<Pair>& pairs) {
    std::vector<std::size_t> inliers;
    for (const Pair& pair : pairs) inliers.push_back(pair.view.inliers.size());
    Reconstruction made;
    made.models.resize(1);
    made.models[0].images.resize(5);
    for (std::size_t i = 0; i < 5; ++i) {
      made.models[0].images[i].registered = true;
      made.models[0].images[i].pose.translation = {static_cast<double>(i), 0, 0};
    }
    show_points(made.models[0], {0, 0, 8}, 4);
    made.trust = {trusts.at(calls.size())};
    made.shapes.resize(1);
    calls.push_back(std::move(inliers));
    return made;
  }
};

TEST(StrongPairs, WeakerPairsAreAddedWhileScoreRises) {
  const Pair wrong = wrong_pair(0, 4, 70, CV_PI / 2);
  const std::vector<Pair> pairs{verified_pair(0, 1, 100),
                                verified_pair(1, 2, 100),
                                verified_pair(2, 3, 100),
                                verified_pair(3, 4, 100),
                                wrong,
                                verified_pair(1, 3, 85),
                                verified_pair(1, 4, 30)};
  FakeMapper mapper{{0.5, 0.6, 0.4, 0.6}, {}};
  const Reconstruction made =
      map_strong_pairs_first(pairs, std::vector<PatchRejection>(pairs.size()), 5, std::ref(mapper));
  using Inliers = std::vector<std::size_t>;
  ASSERT_EQ(mapper.calls.size(), 4U);
  EXPECT_EQ(mapper.calls[0], (Inliers{100, 100, 100, 100, 0, 0, 0}));
  EXPECT_EQ(mapper.calls[1], (Inliers{100, 100, 100, 100, 0, 85, 0}));
  EXPECT_EQ(mapper.calls[2],
            (Inliers{100, 100, 100, 100, 0, 85, 0}));  // without the wrong pair: worse
  EXPECT_EQ(mapper.calls[3],
            (Inliers{100, 100, 100, 100, 0, 85, 30}));  // the pairs that agree with the model
  ASSERT_EQ(made.refused.size(), 1U);
  EXPECT_EQ(made.refused[0].second, 4);
  EXPECT_EQ(made.trust[0], 0.6);
}

TEST(StrongPairs, ScoreMayFallSlightlyWherePatchesDiffer) {
  const std::vector<Pair> pairs{verified_pair(0, 1, 100), verified_pair(1, 2, 100),
                                verified_pair(2, 3, 100), verified_pair(3, 4, 100),
                                verified_pair(1, 3, 85),  verified_pair(1, 4, 30),
                                verified_pair(0, 4, 40)};
  const auto calls_with = [&](const std::vector<PatchRejection>& rejections) {
    FakeMapper mapper{{0.6, 0.57, 0.3, 0.3, 0.3}, {}};
    (void)map_strong_pairs_first(pairs, rejections, 5, std::ref(mapper));
    return mapper.calls.size();
  };
  std::vector<PatchRejection> rejections(pairs.size());
  // The second is worse; then the pairs that agree with the best model.
  EXPECT_EQ(calls_with(rejections), 3U);
  rejections.back() = kPatchesDiffer;
  EXPECT_EQ(calls_with(rejections), 4U);
}

TEST(StrongPairs, RejectedPairsAreUsedOnlyWhereModelAgrees) {
  const Pair wrong = wrong_pair(0, 4, 100, CV_PI / 2);
  const std::vector<Pair> pairs{verified_pair(0, 1, 100),
                                verified_pair(1, 2, 100),
                                verified_pair(2, 3, 100),
                                verified_pair(3, 4, 100),
                                wrong,
                                verified_pair(1, 3, 100)};
  FakeMapper mapper{{0.5, 0.4, 0.6}, {}};
  const Reconstruction made = map_strong_pairs_first(
      pairs, {{}, {}, {}, {}, kPatchesDiffer, kPatchesDiffer}, 5, std::ref(mapper));
  using Inliers = std::vector<std::size_t>;
  ASSERT_EQ(mapper.calls.size(), 3U);
  EXPECT_EQ(mapper.calls[0], (Inliers{100, 100, 100, 100, 0, 0}));
  EXPECT_EQ(mapper.calls[2], (Inliers{100, 100, 100, 100, 0, 100}));
  ASSERT_EQ(made.refused.size(), 1U);
  EXPECT_EQ(made.refused[0].reason, "differ");
}

TEST(StrongPairs, TrustFallsWithAgreeingRejectedPairs) {
  FakeMapper mapper{{0.8}, {}};
  Reconstruction made = mapper({});
  made.outcomes.assign(5, {});
  for (Outcome& outcome : made.outcomes) {
    outcome.model = 0;
    outcome.trust = 1;
  }
  const std::vector<Pair> pairs{verified_pair(0, 1, 100), verified_pair(1, 2, 100),
                                verified_pair(2, 3, 100), verified_pair(3, 4, 100)};
  const std::vector<PatchRejection> rejections{kPatchesDiffer, {}, {"few", false}, {}};
  lower_trust(pairs, rejections, made);
  EXPECT_DOUBLE_EQ(made.trust[0], (0 + 0.5 + 3 * 1) / 5);
  EXPECT_DOUBLE_EQ(made.outcomes[1].trust, 0.5);
}

TEST(StrongPairs, WholeModelIsAsGoodAsPartsOfSimilarScore) {
  const auto made_of = [](const std::vector<int>& sizes, double trust) {
    Reconstruction made;
    for (const int size : sizes) {
      Model& model = made.models.emplace_back();
      model.images.resize(static_cast<std::size_t>(size));
      for (Image& image : model.images) image.registered = true;
    }
    made.trust.assign(sizes.size(), trust);
    made.shapes.resize(sizes.size());
    return made;
  };
  const Reconstruction parts = made_of({7, 7}, 0.6);
  EXPECT_DOUBLE_EQ(score_of(parts), 6);
  EXPECT_TRUE(is_as_good(made_of({14}, 0.46), parts, 0.9));
  EXPECT_FALSE(is_as_good(made_of({14}, 0.44), parts, 0.9));
  EXPECT_FALSE(is_as_good(made_of({14}, 0.46), parts, 1));
  EXPECT_FALSE(is_as_good(made_of({7, 7}, 0.59), parts, 0.9));
  EXPECT_FALSE(is_as_good(parts, made_of({14}, 0.51), 0.9));
}

// The models of a whole have a lower trust than parts, which do not see the places that look alike.
TEST(StrongPairs, PrefersTheWholeToItsParts) {
  constexpr int kImages = 12;
  constexpr int kHalf = 6;
  const Model row = row_of_images(kImages);
  std::vector<Pair> pairs;
  for (int i = 0; i + 1 < kImages; ++i) pairs.push_back(pair_of_poses(row, i, i + 1, 100));
  const auto of_row = [&](int begin, int end, double trust, Reconstruction& made) {
    made.models.push_back(row);
    made.trust.push_back(trust);
    made.shapes.emplace_back();
    for (int i = 0; i < kImages; ++i)
      made.models.back().images[at(i)].registered = i >= begin && i < end;
  };
  Reconstruction parts;
  of_row(0, kHalf, 1, parts);
  of_row(kHalf, kImages, 1, parts);  // score 8
  for (const double trust : {0.66, 0.62}) {
    Reconstruction whole;
    of_row(0, kImages, trust, whole);  // score 6.6, or 6.2
    int calls = 0;
    const Reconstruction made = map_strong_pairs_first(
        pairs, std::vector<PatchRejection>(pairs.size()), kImages,
        [&](const std::vector<Pair>&) { return calls++ == 0 ? parts : whole; });
    EXPECT_EQ(made.models.size(), trust > 0.64 ? 1U : 2U);
    EXPECT_EQ(better_of(pairs, parts, whole).models.size(), trust > 0.64 ? 1U : 2U);
    EXPECT_EQ(better_of(pairs, whole, parts).models.size(), trust > 0.64 ? 1U : 2U);
  }
}

TEST(StrongPairs, PropagatesInterruptionAndKeepsBetterModel) {
  const MapPairs interrupted = [](const std::vector<Pair>&) -> Reconstruction {
    throw Interrupted();
  };
  EXPECT_THROW((void)map_strong_pairs_first({verified_pair(0, 1, 50)}, {{}}, 2, interrupted),
               Interrupted);
  FakeMapper mapper{{0.5, 0.6}, {}};
  Reconstruction first = mapper({});
  first.resumed = 3;
  first.log = {"a"};
  const Reconstruction second = mapper({});
  const Reconstruction kept = better_of({}, first, second);
  EXPECT_EQ(kept.trust[0], 0.6);
  EXPECT_EQ(kept.resumed, 3);
  EXPECT_EQ(kept.log[0], "a");
  EXPECT_EQ(better_of({}, second, first).trust[0], 0.6);
}

}  // namespace
}  // namespace tarsier::sfm
