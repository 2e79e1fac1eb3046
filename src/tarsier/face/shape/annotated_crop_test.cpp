// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/annotated_crop.h"

#include <gtest/gtest.h>

#include <cmath>

namespace tarsier::face::shape {
namespace {

// The value of each pixel is its position. So a cut shows where its pixels come from.
cv::Mat coordinate_image(int width, int height) {
  cv::Mat image(height, width, CV_32FC2);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      image.at<cv::Vec2f>(y, x) = {static_cast<float>(x), static_cast<float>(y)};
    }
  }
  return image;
}

// Between the pixels, linearly.
Eigen::Vector2d value_at(const cv::Mat& image, const Eigen::Vector2d& p) {
  const int x = static_cast<int>(std::floor(p.x()));
  const int y = static_cast<int>(std::floor(p.y()));
  const auto fx = static_cast<float>(p.x() - x);
  const auto fy = static_cast<float>(p.y() - y);
  const cv::Vec2f v =
      (image.at<cv::Vec2f>(y, x) * (1 - fx) + image.at<cv::Vec2f>(y, x + 1) * fx) * (1 - fy) +
      (image.at<cv::Vec2f>(y + 1, x) * (1 - fx) + image.at<cv::Vec2f>(y + 1, x + 1) * fx) * fy;
  return {v[0], v[1]};
}

// px; averaging over fractions of pixels deviates from a straight line by this much
constexpr double kTolerance = 0.06;

LandmarkSample triangle() {
  LandmarkSample sample;
  sample.points.resize(2, 3);
  sample.points << 100.25, 181.5, 133, 90, 98.75, 170;
  sample.box = cv::Rect2d(95, 85, 90, 90);
  return sample;
}

TEST(AnnotatedCrop, PointsKeepTheirPixelsAtAnyReduction) {
  const LandmarkSample sample = triangle();
  for (const int largest : {400, 60, 37, 11}) {
    const AnnotatedCrop crop = crop_around_points(coordinate_image(320, 240), sample, 0.5, largest);
    for (int p = 0; p < 3; ++p) {
      const Eigen::Vector2d there = value_at(crop.image, crop.points.col(p));
      EXPECT_LT((there - sample.points.col(p)).norm(), kTolerance) << largest << ' ' << p;
    }
    ASSERT_TRUE(crop.box);
    EXPECT_LT((value_at(crop.image, {crop.box->x, crop.box->y}) - Eigen::Vector2d(95, 85)).norm(),
              kTolerance);
    EXPECT_NEAR(crop.box->width * crop.scale, 90, 1) << largest;
  }
}

TEST(AnnotatedCrop, KeepsTheMarginAndNeverEnlarges) {
  const AnnotatedCrop whole_size =
      crop_around_points(coordinate_image(320, 240), triangle(), 0.5, 4000);
  EXPECT_EQ(whole_size.scale, 1);
  // The points' box is 81.25 px wide: half of that on each side.
  EXPECT_EQ((whole_size.image.at<cv::Vec2f>(0, 0)), cv::Vec2f(59, 49));
  EXPECT_EQ(whole_size.image.size(), cv::Size(165, 163));
  const AnnotatedCrop reduced = crop_around_points(coordinate_image(320, 240), triangle(), 0.5, 20);
  const Eigen::Vector2d extent =
      reduced.points.rowwise().maxCoeff() - reduced.points.rowwise().minCoeff();
  EXPECT_NEAR(extent.maxCoeff(), 20, 0.2);
}

TEST(AnnotatedCrop, PointsOutsideTheImageKeepTheWholeImage) {
  LandmarkSample sample = triangle();
  sample.points.array() += 1e12;
  const AnnotatedCrop crop = crop_around_points(coordinate_image(32, 24), sample, 0.5, 400);
  EXPECT_EQ(crop.image.size(), cv::Size(32, 24));
}

TEST(AnnotatedCrop, MirroredPointsKeepTheirPixels) {
  const LandmarkSample sample = triangle();
  const AnnotatedCrop crop = crop_around_points(coordinate_image(320, 240), sample, 0.5, 60);
  const AnnotatedCrop turned = mirrored(crop, {1, 0, 2}, 0);
  for (int p = 0; p < 3; ++p) {
    const int counterpart = p == 2 ? 2 : 1 - p;
    const Eigen::Vector2d there = value_at(turned.image, turned.points.col(p));
    EXPECT_LT((there - sample.points.col(counterpart)).norm(), kTolerance) << p;
  }
  // Counted from 1, points lie one pixel to the right of the marked place, also mirrored points.
  const AnnotatedCrop moved = mirrored(crop, {1, 0, 2}, 1);
  EXPECT_NEAR(moved.points(0, 0) - turned.points(0, 0), 2 / crop.scale, 1e-9);
}

}  // namespace
}  // namespace tarsier::face::shape
