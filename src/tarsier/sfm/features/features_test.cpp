// SPDX-License-Identifier: MIT
#include "tarsier/sfm/features/features.h"

#include "tarsier/synth/sfm_scene.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <cmath>

namespace tarsier::sfm {
namespace {

cv::Mat blob_image(double x, double y, double sigma) {
  cv::Mat image(160, 200, CV_8UC1);
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols; ++u) {
      const double d = (u - x) * (u - x) + (v - y) * (v - y);
      image.at<std::uint8_t>(v, u) =
          cv::saturate_cast<std::uint8_t>(120 + 100 * std::exp(-d / (2 * sigma * sigma)));
    }
  }
  return image;
}

TEST(FindFeatures, LocatesBlobCentre) {
  for (const double sigma : {2.2, 4.0, 6.0}) {
    for (const cv::Point2d at : {cv::Point2d(100, 80), cv::Point2d(91.3, 79.6)}) {
      const Features features = find_features(blob_image(at.x, at.y, sigma), {});
      ASSERT_FALSE(features.points.empty()) << sigma;
      double nearest = 1e9;
      for (const cv::Point2f& p : features.points)
        nearest = std::min(nearest, cv::norm(cv::Point2d(p) - at));
      EXPECT_LT(nearest, 0.06) << sigma << at;
    }
  }
}

TEST(FindFeatures, ReducedImageGivesFullImageCoordinates) {
  const synth::SfmScene scene({});
  const cv::Mat image = scene.render(0);
  FeatureOptions half;
  half.max_pixels = static_cast<double>(image.total()) / 4;
  half.max_count = 300;
  const Features features = find_features(image, half);
  ASSERT_GT(features.points.size(), 100U);
  float right = 0;
  for (const cv::Point2f& p : features.points) right = std::max(right, p.x);
  EXPECT_GT(right, 0.8F * static_cast<float>(image.cols));
  ASSERT_EQ(features.descriptors.rows, static_cast<int>(features.points.size()));
  EXPECT_EQ(features.colors.size(), features.points.size());
}

TEST(FindFeatures, KeepsStrongestOfEachRegion) {
  const synth::SfmScene scene({});
  cv::Mat image = scene.render(0);
  // The left half has much less contrast, but keeps its share of the features.
  cv::Mat left = image(cv::Rect(0, 0, image.cols / 2, image.rows));
  left.convertTo(left, -1, 0.45, 70);
  FeatureOptions options;
  options.max_count = 400;
  options.contrast = 0.01;
  const Features features = find_features(image, options);
  EXPECT_LE(features.points.size(), 400U);
  const auto of_left =
      std::count_if(features.points.begin(), features.points.end(),
                    [&](const cv::Point2f& p) { return 2 * p.x < static_cast<float>(image.cols); });
  EXPECT_GT(of_left, 80);
}

TEST(FindFeatures, ResultDoesNotDependOnNumberOfThreads) {
  const synth::SfmScene scene({});
  const cv::Mat image = scene.render(1);
  for (const FeatureKind kind : {FeatureKind::kSift, FeatureKind::kOrb, FeatureKind::kAkaze}) {
    FeatureOptions options;
    options.kind = kind;
    cv::setNumThreads(1);
    const Features one = find_features(image, options);
    cv::setNumThreads(4);
    const Features four = find_features(image, options);
    cv::setNumThreads(-1);
    ASSERT_GT(one.points.size(), 50U);
    EXPECT_EQ(one.points, four.points);
    EXPECT_EQ(cv::norm(one.descriptors, four.descriptors, cv::NORM_INF), 0);
  }
}

TEST(FindFeatures, FindsNothingInUniformImage) {
  EXPECT_TRUE(find_features(cv::Mat(100, 100, CV_8UC3, cv::Scalar::all(128)), {}).points.empty());
  EXPECT_THROW((void)find_features(cv::Mat(), {}), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::sfm
