// SPDX-License-Identifier: MIT
#include "tarsier/sfm/consistency/patch_evidence.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <numeric>

namespace tarsier::sfm {
namespace {

using testing::HasSubstr;

cv::Mat texture(std::uint64_t seed) {
  cv::Mat image(240, 320, CV_8UC1);
  Rng rng(seed);
  for (int y = 0; y < image.rows; ++y)
    for (int x = 0; x < image.cols; ++x)
      image.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(rng.integer(0, 255));
  cv::GaussianBlur(image, image, {}, 2);
  cv::normalize(image, image, 0, 255, cv::NORM_MINMAX);
  return image;
}

const cv::Matx23d kMove(0.95, 0.1, 12, -0.08, 1.02, 9);  // from the first image to the second

// A plane in two images, with features every 6 px; those of odd columns have no match.
struct Views {
  PatchImage first;
  PatchImage second;
  std::vector<Match> inliers;
};

Views views(const cv::Mat& shown_first, const cv::Mat& shown_second) {
  Views result;
  result.first.gray = shown_first;
  cv::warpAffine(shown_second, result.second.gray, kMove, shown_second.size());
  for (int y = 24; y < 210; y += 6) {
    for (int x = 24; x < 290; x += 6) {
      const cv::Vec2d at = kMove * cv::Vec3d(x, y, 1);
      result.first.features.emplace_back(static_cast<float>(x), static_cast<float>(y));
      result.second.features.emplace_back(static_cast<float>(at[0]), static_cast<float>(at[1]));
      const int i = static_cast<int>(result.first.features.size()) - 1;
      if (x / 6 % 2 == 0) result.inliers.push_back({i, i});
    }
  }
  return result;
}

TEST(ComparePatches, UnmatchedPatchesOfOnePlaceAreEqual) {
  cv::Mat brighter;
  texture(1).convertTo(brighter, CV_8U, 0.7, 40);
  const Views given = views(texture(1), brighter);
  const PatchEvidence evidence = compare_patches(given.first, given.second, given.inliers);
  EXPECT_GT(evidence.same, 150);
  EXPECT_EQ(evidence.differ, 0);
}

TEST(ComparePatches, FindsMissingDetail) {
  const cv::Mat plain = texture(1);
  cv::Mat other = plain.clone();
  const cv::Rect detail(150, 90, 24, 24);
  texture(2)(detail).copyTo(other(detail));
  Views given = views(plain, other);
  std::erase_if(given.inliers, [&](const Match& match) {
    return detail.contains(given.first.features[static_cast<std::size_t>(match.first)]);
  });
  const PatchEvidence evidence = compare_patches(given.first, given.second, given.inliers);
  EXPECT_GT(evidence.differ, 5);
  EXPECT_GT(evidence.same, 100);
  EXPECT_GT(evidence.share(), 0.01);
}

TEST(ComparePatches, SkipsPatchesWithoutSurroundingMatchesOrContrast) {
  const cv::Mat plain = texture(1);
  cv::Mat other = plain.clone();
  const cv::Rect elsewhere(140, 0, 180, 240);
  texture(2)(elsewhere).copyTo(other(elsewhere));
  Views given = views(plain, other);
  std::erase_if(given.inliers, [&](const Match& match) {
    return given.first.features[static_cast<std::size_t>(match.first)].x > 120;
  });
  const PatchEvidence near = compare_patches(given.first, given.second, given.inliers);
  EXPECT_GT(near.same, 100);
  EXPECT_EQ(near.differ, 0);
  const Views bare = views(cv::Mat(240, 320, CV_8UC1, cv::Scalar(90)), texture(1));
  EXPECT_EQ(compare_patches(bare.first, bare.first, bare.inliers).share(), 0);
  EXPECT_THROW((void)compare_patches({cv::Mat(9, 9, CV_8UC3), {}}, given.second, {}),
               std::invalid_argument);
}

Pair unverified_pair(int first, int second, std::size_t inliers) {
  Pair pair;
  pair.first = first;
  pair.second = second;
  pair.view.inliers = std::vector<Match>(inliers);
  return pair;
}

TEST(ComparePatches, AllPairsEqualSinglePairsAndSkipMissingPixels) {
  const Views given = views(texture(1), texture(1));
  std::vector<Pair> pairs{unverified_pair(0, 1, 0), unverified_pair(0, 2, 0),
                          unverified_pair(1, 2, 0)};
  pairs[0].view.inliers = given.inliers;
  pairs[1].view.inliers = given.inliers;
  const std::vector<std::vector<cv::Point2f>> features{given.first.features, given.second.features,
                                                       given.second.features};
  const GrayImages gray = [&](int image) {
    return image == 0 ? given.first.gray : image == 1 ? given.second.gray : cv::Mat();
  };
  NoProgress progress;
  const auto evidence = compare_all_patches(features, pairs, gray, progress, {});
  ASSERT_EQ(evidence.size(), 3U);
  EXPECT_EQ(evidence[0].same, compare_patches(given.first, given.second, given.inliers).same);
  EXPECT_EQ(evidence[1].same + evidence[1].differ, 0);
  EXPECT_EQ(evidence[2].same + evidence[2].differ, 0);
  std::stop_source source;
  source.request_stop();
  EXPECT_THROW((void)compare_all_patches(features, pairs, gray, progress, source.get_token()),
               Interrupted);
}

// Images 0 to 2 and images 3 to 5 are of two places that look alike. Every pair matches.
struct Places {
  std::vector<Pair> pairs;
  std::vector<PatchEvidence> evidence;
  Places(int differ_inside, int differ_between) {
    for (int first = 0; first < 6; ++first) {
      for (int second = first + 1; second < 6; ++second) {
        const bool is_inside = first / 3 == second / 3;
        pairs.push_back(unverified_pair(first, second, 100));
        evidence.push_back({300, is_inside ? differ_inside : differ_between});
      }
    }
  }
};

TEST(PatchRejections, ArePairsThatDifferMoreThanBestPairs) {
  for (const int differ_inside : {0, 12}) {  // with relief, patches differ too
    const Places given(differ_inside, differ_inside + 30);
    const std::vector<PatchRejection> rejections =
        rejections_by_patches(given.pairs, 6, given.evidence);
    for (std::size_t k = 0; k < rejections.size(); ++k) {
      if (given.pairs[k].first / 3 == given.pairs[k].second / 3) {
        EXPECT_FALSE(rejections[k]);
      } else {
        EXPECT_THAT(rejections[k].reason, HasSubstr(" differ: the images look alike"));
        EXPECT_TRUE(rejections[k].patches_differ);
      }
    }
  }
  const Places relief(20, 20);
  for (const PatchRejection& rejection : rejections_by_patches(relief.pairs, 6, relief.evidence))
    EXPECT_FALSE(rejection);
}

TEST(PatchRejections, NeighbouringPairsDecideForFewPatches) {
  Places given(0, 20);
  std::size_t index = 0;
  while (given.pairs[index].first != 1 || given.pairs[index].second != 4) ++index;
  given.evidence[index] = {300, 1};
  EXPECT_TRUE(rejections_by_patches(given.pairs, 6, given.evidence)[index].patches_differ);
  given.evidence[index] = {300, 0};
  EXPECT_FALSE(rejections_by_patches(given.pairs, 6, given.evidence)[index]);
  given.evidence[index] = {20, 5};
  const PatchRejection few = rejections_by_patches(given.pairs, 6, given.evidence)[index];
  EXPECT_THAT(few.reason, HasSubstr("only 25 patches could be compared"));
  EXPECT_FALSE(few.patches_differ);
  Places alone(0, 0);
  alone.evidence[index] = {20, 5};
  EXPECT_FALSE(rejections_by_patches(alone.pairs, 6, alone.evidence)[index])
      << "nothing looks alike";
}

}  // namespace
}  // namespace tarsier::sfm
