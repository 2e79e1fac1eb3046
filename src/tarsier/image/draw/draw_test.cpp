// SPDX-License-Identifier: MIT
#include "tarsier/image/draw/shapes.h"
#include "tarsier/image/draw/text.h"
#include "tarsier/image/draw/tile.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

namespace tarsier::image::draw {
namespace {

// The bounding box of all differences between two images.
cv::Rect changed(const cv::Mat& before, const cv::Mat& after) {
  cv::Mat difference;
  cv::absdiff(before, after, difference);
  if (difference.channels() == 3) cv::cvtColor(difference, difference, cv::COLOR_BGR2GRAY);
  return cv::boundingRect(difference > 8);
}

cv::Mat grey_canvas(int width = 320, int height = 240) {
  return {height, width, CV_8UC3, cv::Scalar(90, 90, 90)};
}

TEST(Text, StaysInTheBoxThatItReturnsForEveryAnchorAndBacking) {
  for (const Backing backing : {Backing::kNone, Backing::kOutline, Backing::kBox}) {
    for (int anchor = 0; anchor < 9; ++anchor) {
      for (const double height : {8.0, 14.0, 30.0}) {
        cv::Mat image = grey_canvas();
        const cv::Mat before = image.clone();
        TextStyle style;
        style.backing = backing;
        style.height_px = height;
        const cv::Rect box =
            put_text(image, "Agj 0|", {160, 120}, style, static_cast<Anchor>(anchor));
        const cv::Rect drawn = changed(before, image);
        EXPECT_FALSE(drawn.empty());
        EXPECT_EQ(drawn & box, drawn)
            << "anchor " << anchor << ", height " << height << ": " << drawn << " in " << box;
        EXPECT_EQ(box.size(), text_size("Agj 0|", height));
      }
    }
  }
}

TEST(Text, AnchorsPositionTheBox) {
  cv::Mat image = grey_canvas();
  EXPECT_EQ(put_text(image, "x", {10, 20}).tl(), cv::Point(10, 20));
  EXPECT_EQ(put_text(image, "x", {100, 80}, {}, Anchor::kBottomRight).br(), cv::Point(100, 80));
}

TEST(Text, EachNonAsciiCharacterBecomesOneQuestionMark) {
  EXPECT_EQ(text_size("M\xC3\xBCller", 20), text_size("M?ller", 20));
}

TEST(Text, LinesGoBelowEachOther) {
  EXPECT_GT(text_size("a\nb", 20).height, text_size("a", 20).height + 20);
  EXPECT_EQ(text_size("a\nlonger", 20).width, text_size("longer", 20).width);
}

TEST(Text, IsClippedAtTheEdgeAndOnTinyImages) {
  for (const int type : {CV_8UC1, CV_8UC3}) {
    cv::Mat tiny(1, 1, type, cv::Scalar::all(0));
    put_text(tiny, "far too long for this", {-50, -5});
    status_bar(tiny, "left", "right");
    const std::array<HelpLine, 1> lines{{{"s", "sketch"}}};
    help_overlay(tiny, "Keys", lines);
    button(tiny, {0, 0, 1, 1}, "ok");
    bar(tiny, {0, 0, 1, 1}, 0.5, {0, 255, 0}, "x");
    point(tiny, {1e300, -5}, {255, 255, 255});
    cross(tiny, {std::numeric_limits<double>::quiet_NaN(), 0}, {255, 255, 255});
    EXPECT_EQ(tiny.size(), cv::Size(1, 1));
  }
}

TEST(Text, RefusesUnsupportedImages) {
  cv::Mat empty;
  cv::Mat floats(4, 4, CV_32FC3);
  EXPECT_THROW(put_text(empty, "x", {0, 0}), std::invalid_argument);
  EXPECT_THROW(put_text(floats, "x", {0, 0}), std::invalid_argument);
  cv::Mat image = grey_canvas();
  EXPECT_THROW(put_text(image, "x", {0, 0}, {.height_px = 1000}), std::invalid_argument);
}

TEST(StatusBar, TouchesTheLowerEdgeOnly) {
  cv::Mat image = grey_canvas(640, 480);
  const cv::Mat before = image.clone();
  const cv::Rect bar = status_bar(image, std::string(500, 'w'), "25.0 fps");
  EXPECT_EQ(bar.br(), cv::Point(640, 480));
  EXPECT_EQ(bar.width, 640);
  EXPECT_LT(bar.height, 60);
  const cv::Rect drawn = changed(before, image);
  EXPECT_EQ(drawn & bar, drawn);
}

TEST(StatusBar, NarrowBarKeepsTheLastPartOnTheRight) {
  cv::Mat narrow = grey_canvas(200, 150);
  status_bar(narrow, "3 faces, 2 known", "123.4 ms, 25.0 frames/s   h: help");
  cv::Mat expected = grey_canvas(200, 150);
  status_bar(expected, "3 faces, 2 known", "h: help");
  EXPECT_EQ(cv::norm(narrow, expected, cv::NORM_INF), 0);
  cv::Mat without = grey_canvas(200, 150);
  status_bar(without, "3 faces, 2 known");
  EXPECT_GT(cv::norm(narrow, without, cv::NORM_INF), 0);
}

TEST(HelpOverlay, FitsAnImageWithManyKeys) {
  std::vector<HelpLine> lines(14, {"Esc", "leave the program and write nothing"});
  cv::Mat image = grey_canvas(320, 240);
  const cv::Mat before = image.clone();
  help_overlay(image, "Keys", lines);
  const cv::Rect drawn = changed(before, image);
  EXPECT_GE(drawn.x, 0);
  EXPECT_EQ(image.at<cv::Vec3b>(0, 0), before.at<cv::Vec3b>(0, 0));
  EXPECT_GT(drawn.width, 100);
}

TEST(Shapes, APointIsCentredToAFractionOfAPixel) {
  cv::Mat image(41, 41, CV_8UC1, cv::Scalar(0));
  point(image, {20.25, 19.5}, {255}, 5);
  const cv::Moments m = cv::moments(image);
  EXPECT_NEAR(m.m10 / m.m00, 20.25, 0.1);
  EXPECT_NEAR(m.m01 / m.m00, 19.5, 0.1);
}

TEST(Shapes, RoundedBoxIsSymmetricAndBlends) {
  cv::Mat image(40, 60, CV_8UC1, cv::Scalar(100));
  fill_rounded(image, {10, 8, 40, 24}, 8, {200}, 0.5);
  cv::Mat mirrored;
  cv::flip(image, mirrored, -1);
  EXPECT_EQ(cv::norm(image, mirrored, cv::NORM_INF), 0);
  EXPECT_EQ(image.at<std::uint8_t>(20, 30), 150);
  EXPECT_EQ(image.at<std::uint8_t>(8, 10), 100) << "the corner is cut";
  EXPECT_EQ(image.at<std::uint8_t>(8, 30), 150) << "the edge is not";
}

TEST(Shapes, BarFillsItsFraction) {
  cv::Mat image(20, 120, CV_8UC3, cv::Scalar(0, 0, 0));
  bar(image, {10, 5, 100, 10}, 0.25, {0, 255, 0});
  EXPECT_EQ(image.at<cv::Vec3b>(10, 25)[1], 255);
  EXPECT_LT(image.at<cv::Vec3b>(10, 60)[1], 60);
  EXPECT_THROW(bar(image, {10, 5, 100, 10}, 1.5, {0, 255, 0}), std::invalid_argument);
}

TEST(Tile, ShowsEveryKindOfImageInItsCell) {
  cv::Mat red(30, 40, CV_8UC3, cv::Scalar(0, 0, 255));
  cv::Mat white(60, 20, CV_8UC1, cv::Scalar(255));
  cv::Mat ramp(10, 10, CV_32FC1);
  for (int i = 0; i < 100; ++i) ramp.at<float>(i / 10, i % 10) = static_cast<float>(i);
  ramp.at<float>(0, 1) = std::numeric_limits<float>::quiet_NaN();
  ramp.at<float>(0, 2) = std::numeric_limits<float>::infinity();
  const std::vector<cv::Mat> images{red, white, ramp, cv::Mat()};
  const std::vector<std::string> names{"", "", "", "missing"};
  const cv::Mat grid = tile(images, names, {400, 300});
  ASSERT_EQ(grid.size(), cv::Size(400, 300));
  ASSERT_EQ(grid.type(), CV_8UC3);
  EXPECT_EQ(grid.at<cv::Vec3b>(75, 100), cv::Vec3b(0, 0, 255));
  EXPECT_EQ(grid.at<cv::Vec3b>(75, 300), cv::Vec3b(255, 255, 255));
  EXPECT_EQ(grid.at<cv::Vec3b>(75, 210), cv::Vec3b(32, 32, 32))
      << "aspect kept: ground beside the tall one";
}

TEST(Tile, FitsManyImagesAndRefusesInvalidOnes) {
  const std::vector<cv::Mat> many(200, cv::Mat(5, 5, CV_8UC1, cv::Scalar(7)));
  const std::vector<std::string> names(200, "n");
  EXPECT_EQ(tile(many, names, {16, 16}).size(), cv::Size(16, 16));
  EXPECT_EQ(tile({}, {}, {64, 48}).size(), cv::Size(64, 48));
  const std::vector<cv::Mat> one(1, cv::Mat(5, 5, CV_32SC1));
  const std::vector<std::string> name(1, "n");
  EXPECT_THROW((void)tile(one, name, {64, 48}), std::invalid_argument);
  EXPECT_THROW((void)tile(many, name, {64, 48}), std::invalid_argument);
}

TEST(Letterbox, KeepsTheAspect) {
  const cv::Mat wide(50, 100, CV_8UC3, cv::Scalar(255, 255, 255));
  const cv::Mat boxed = letterbox(wide, {100, 100});
  EXPECT_EQ(boxed.at<cv::Vec3b>(50, 50), cv::Vec3b(255, 255, 255));
  EXPECT_EQ(boxed.at<cv::Vec3b>(20, 50), cv::Vec3b(0, 0, 0));
  EXPECT_EQ(boxed.at<cv::Vec3b>(26, 50), cv::Vec3b(255, 255, 255));
}

}  // namespace
}  // namespace tarsier::image::draw
