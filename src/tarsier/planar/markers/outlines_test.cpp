// SPDX-License-Identifier: MIT
#include "tarsier/planar/markers/outlines.h"

#include "tarsier/core/rng.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <stdexcept>

namespace tarsier::planar::markers {
namespace {

cv::Rect bounds(std::span<const cv::Point> outline) {
  return cv::boundingRect(std::vector<cv::Point>(outline.begin(), outline.end()));
}

TEST(Outlines, TraceDarkRegionOnceClockwise) {
  cv::Mat gray(50, 71, CV_8UC1, cv::Scalar(200));  // not a multiple of the tile size
  gray(cv::Rect(10, 20, 30, 15)).setTo(40);
  OutlineWorkspace w;
  find_dark_outlines(gray, {}, w);
  ASSERT_EQ(w.outlines.size(), 1U);
  const auto outline = w.outline(0);
  EXPECT_EQ(bounds(outline), cv::Rect(10, 20, 30, 15));
  EXPECT_EQ(outline.size(), 2U * (29 + 14));
  double twice = 0;
  for (std::size_t i = 0; i < outline.size(); ++i) {
    const cv::Point a = outline[i];
    const cv::Point b = outline[(i + 1) % outline.size()];
    EXPECT_EQ(std::abs(a.x - b.x) + std::abs(a.y - b.y), 1);
    twice += a.x * b.y - a.y * b.x;
  }
  EXPECT_EQ(twice, 2 * 29 * 14);  // positive: clockwise where y points down
}

TEST(Outlines, TraceOuterBorderOfRingAndInnerRegion) {
  cv::Mat gray(100, 100, CV_8UC1, cv::Scalar(180));
  gray(cv::Rect(20, 20, 60, 60)).setTo(30);
  gray(cv::Rect(28, 28, 44, 44)).setTo(180);
  gray(cv::Rect(40, 40, 20, 20)).setTo(30);
  OutlineWorkspace w;
  find_dark_outlines(gray, {}, w);
  ASSERT_EQ(w.outlines.size(), 2U);
  EXPECT_EQ(bounds(w.outline(0)), cv::Rect(20, 20, 60, 60));
  EXPECT_EQ(bounds(w.outline(1)), cv::Rect(40, 40, 20, 20));
}

TEST(Outlines, AreFourConnected) {
  cv::Mat gray(60, 60, CV_8UC1, cv::Scalar(180));
  gray(cv::Rect(10, 10, 20, 20)).setTo(30);
  gray(cv::Rect(30, 30, 20, 20)).setTo(30);
  OutlineWorkspace w;
  find_dark_outlines(gray, {}, w);
  EXPECT_EQ(w.outlines.size(), 2U);
}

TEST(Outlines, MergeRegionsThatJoinBelow) {
  cv::Mat gray(60, 60, CV_8UC1, cv::Scalar(180));  // a W
  for (const int x : {10, 25, 40}) gray(cv::Rect(x, 10, 6, 30)).setTo(30);
  gray(cv::Rect(10, 40, 36, 6)).setTo(30);
  OutlineWorkspace w;
  find_dark_outlines(gray, {}, w);
  // At a depth of three bars, the outline is too long for a convex component of this size, and it
  // is left out.
  EXPECT_TRUE(w.outlines.empty());
  gray(cv::Rect(16, 10, 9, 30)).setTo(30);
  find_dark_outlines(gray, {}, w);
  ASSERT_EQ(w.outlines.size(), 1U);
  EXPECT_EQ(bounds(w.outline(0)), cv::Rect(10, 10, 36, 36));
}

TEST(Outlines, IgnoreNoise) {
  Rng rng(3);
  cv::Mat gray(240, 320, CV_8UC1);
  for (int y = 0; y < gray.rows; ++y)
    for (int x = 0; x < gray.cols; ++x)
      gray.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(150 + 8 * rng.normal());
  cv::Mat component = gray(cv::Rect(100, 80, 50, 40));
  cv::subtract(component, cv::Scalar(60), component);
  OutlineWorkspace w;
  find_dark_outlines(gray, {}, w);
  EXPECT_LE(w.components.size(), 1000U);  // of 8000 specks: looking at all would take too long
  cv::Rect largest;
  for (std::size_t i = 0; i < w.outlines.size(); ++i)
    if (bounds(w.outline(i)).area() > largest.area()) largest = bounds(w.outline(i));
  EXPECT_NEAR(largest.x, 100, 2);
  EXPECT_NEAR(largest.width, 50, 4);
}

// There is no flat area to measure the noise.
TEST(Outlines, FindManySmallRegions) {
  cv::Mat gray(80, 80, CV_8UC1, cv::Scalar(200));
  for (int y = 4; y < 80; y += 16)
    for (int x = 4; x < 80; x += 16) gray(cv::Rect(x, y, 8, 8)).setTo(90);
  OutlineWorkspace w;
  find_dark_outlines(gray, {}, w);
  EXPECT_EQ(w.outlines.size(), 25U);
}

TEST(Outlines, AreEmptyForFlatEmptyOrTinyImages) {
  OutlineWorkspace w;
  for (const cv::Size size : {cv::Size(0, 0), cv::Size(1, 1), cv::Size(3, 200), cv::Size(64, 64)}) {
    find_dark_outlines(cv::Mat(size, CV_8UC1, cv::Scalar(90)), {}, w);
    EXPECT_TRUE(w.outlines.empty());
  }
  EXPECT_THROW(find_dark_outlines(cv::Mat(9, 9, CV_8UC3), {}, w), std::invalid_argument);
  EXPECT_THROW(find_dark_outlines(cv::Mat(9, 9, CV_8UC1), {.min_contrast = 1}, w),
               std::invalid_argument);
}

TEST(Outlines, ReachTheEdgesOfTheImage) {
  cv::Mat gray(40, 129, CV_8UC1, cv::Scalar(30));
  gray(cv::Rect(60, 0, 9, 40)).setTo(200);
  OutlineWorkspace w;
  find_dark_outlines(gray, {}, w);
  ASSERT_EQ(w.outlines.size(), 2U);
  EXPECT_EQ(bounds(w.outline(0)).br().x, 60);
  EXPECT_EQ(bounds(w.outline(1)).x, 69);
  EXPECT_EQ(bounds(w.outline(1)).height, 40);
}

}  // namespace
}  // namespace tarsier::planar::markers
