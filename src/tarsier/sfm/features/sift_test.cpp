// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/sift.h"

#include "tarsier/core/cpu.h"
#include "tarsier/sfm/features/matching.h"
#include "tarsier/sfm/features/sift_kernels.h"
#include "tarsier/synth/sfm_scene.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace tarsier::sfm {
namespace {

cv::Mat scene_image() {
  cv::Mat gray;
  cv::cvtColor(synth::SfmScene(synth::SceneOptions{}).render(0), gray, cv::COLOR_BGR2GRAY);
  return gray;
}

struct MatchQuality {
  int matches = 0;
  int correct = 0;
  double median_error = 0;  // px, of the right matches
};

// The share of matches between an image and its warp that are within 1.5 px of the truth.
MatchQuality matched(const cv::Mat& image, const cv::Matx23d& warp, cv::Size size) {
  cv::Mat warped;
  cv::warpAffine(image, warped, warp, size, cv::INTER_CUBIC, cv::BORDER_REFLECT);
  const SiftFeatures a = find_sift(image, {.max_count = 1500});
  const SiftFeatures b = find_sift(warped, {.max_count = 1500});
  MatchQuality quality;
  std::vector<double> errors;
  for (const Match& match : match_features(a.descriptors, b.descriptors, FeatureKind::kSift, {})) {
    const cv::Point2f p = a.points[static_cast<std::size_t>(match.first)];
    const cv::Vec2d at = warp * cv::Vec3d(p.x, p.y, 1);
    const cv::Point2f q = b.points[static_cast<std::size_t>(match.second)];
    const double error = std::hypot(at[0] - q.x, at[1] - q.y);
    ++quality.matches;
    if (error > 1.5) continue;
    ++quality.correct;
    errors.push_back(error);
  }
  if (!errors.empty()) {
    std::nth_element(errors.begin(),
                     errors.begin() + static_cast<std::ptrdiff_t>(errors.size() / 2), errors.end());
    quality.median_error = errors[errors.size() / 2];
  }
  return quality;
}

TEST(FindSift, MatchesRotatedAndScaledImage) {
  const cv::Mat image = scene_image();
  const cv::Point2f center(static_cast<float>(image.cols) / 2, static_cast<float>(image.rows) / 2);
  for (const auto& [angle, scale] :
       {std::pair{0.0, 0.8}, std::pair{37.0, 1.0}, std::pair{90.0, 1.0}, std::pair{-120.0, 0.7}}) {
    SCOPED_TRACE(testing::Message() << angle << " degrees, " << scale);
    const cv::Mat warp = cv::getRotationMatrix2D(center, angle, scale);
    const MatchQuality quality = matched(image, cv::Matx23d(warp), image.size());
    EXPECT_GT(quality.correct, 200);
    EXPECT_GT(quality.correct, 0.9 * quality.matches);
    EXPECT_LT(quality.median_error, 0.25);
  }
}

TEST(FindSift, LocatesFeaturesWithSubpixelAccuracy) {
  const cv::Mat image = scene_image();
  const MatchQuality quality = matched(image, {1, 0, 0.37, 0, 1, -0.61}, image.size());
  EXPECT_GT(quality.correct, 500);
  EXPECT_LT(quality.median_error, 0.06);
}

TEST(FindSift, IsTheSameForAnyNumberOfThreads) {
  const cv::Mat image = scene_image();
  const int before = cv::getNumThreads();
  cv::setNumThreads(1);
  const SiftFeatures one = find_sift(image, {.max_count = 700});
  cv::setNumThreads(4);
  const SiftFeatures four = find_sift(image, {.max_count = 700});
  cv::setNumThreads(before);
  EXPECT_EQ(one.points, four.points);
  EXPECT_EQ(one.sizes, four.sizes);
  EXPECT_EQ(cv::norm(one.descriptors, four.descriptors, cv::NORM_INF), 0);
  EXPECT_EQ(one.points.size(), 700U);
}

TEST(FindSift, InstructionSetsAgreeWithinRounding) {
  const cv::Mat image = scene_image();
  const SimdLevel best = simd_level();
  limit_simd_level(SimdLevel::kBaseline);
  const SiftFeatures base = find_sift(image, {.max_count = 500});
  for (const SimdLevel level : {SimdLevel::kAvx2, SimdLevel::kAvx512}) {
    if (level > best) continue;
    limit_simd_level(best);
    limit_simd_level(level);
    const SiftFeatures other = find_sift(image, {.max_count = 500});
    ASSERT_EQ(other.points.size(), base.points.size()) << name_of(level);
    int equal = 0;
    for (std::size_t i = 0; i < base.points.size(); ++i) {
      const int k = static_cast<int>(i);
      equal += cv::norm(base.points[i] - other.points[i]) < 1e-3 &&
               cv::norm(base.descriptors.row(k), other.descriptors.row(k), cv::NORM_INF) <= 2;
    }
    EXPECT_GT(equal, 490) << name_of(level);
  }
  limit_simd_level(best);
}

TEST(FindSift, ToleratesUniformAndTinyImages) {
  EXPECT_TRUE(find_sift(cv::Mat(100, 120, CV_8UC1, cv::Scalar(90)), {}).points.empty());
  for (const cv::Size size : {cv::Size(1, 1), cv::Size(7, 300), cv::Size(8, 8), cv::Size(9, 11)}) {
    cv::Mat image(size, CV_8UC1);
    cv::randu(image, 0, 255);
    const SiftFeatures features = find_sift(image, {});
    EXPECT_EQ(features.descriptors.rows, static_cast<int>(features.points.size())) << size;
  }
  EXPECT_THROW((void)find_sift(cv::Mat(20, 20, CV_8UC3), {}), std::invalid_argument);
  EXPECT_THROW((void)find_sift(cv::Mat(20, 20, CV_8UC1), {.max_count = 0}), std::invalid_argument);
}

TEST(FindSift, AddsWeakFeaturesInWeakTexture) {
  cv::Mat weak;
  scene_image().convertTo(weak, -1, 0.12, 100);
  const SiftFeatures strong = find_sift(weak, {.min_count = 0});
  const SiftFeatures all = find_sift(weak, {.min_count = 900});
  EXPECT_LT(strong.points.size(), 700U);
  EXPECT_GT(all.points.size(), 800U);
  EXPECT_LT(all.points.size(), 1300U);
  // The high-contrast features are among them.
  for (const cv::Point2f& p : strong.points)
    EXPECT_NE(std::find(all.points.begin(), all.points.end(), p), all.points.end());
  // If there are enough features, nothing changes.
  const cv::Mat image = scene_image();
  EXPECT_EQ(find_sift(image, {.min_count = 0}).points, find_sift(image, {}).points);
}

TEST(SelectByCells, TakesStrongestOfEachCellFirst) {
  // Two cells: strong features on the left, weak features on the right.
  const std::vector<cv::Point2f> points{{1, 1}, {2, 1}, {3, 1}, {158, 1}, {157, 1}};
  const std::vector<float> responses{5, 9, 7, 1, 2};
  EXPECT_EQ(select_by_cells(points, responses, {160, 10}, 3), (std::vector<int>{1, 4, 2}));
  EXPECT_EQ(select_by_cells(points, responses, {160, 10}, 100), (std::vector<int>{1, 4, 2, 3, 0}));
}

}  // namespace
}  // namespace tarsier::sfm
