// SPDX-License-Identifier: MIT
#include "letterbox.h"

#include <gtest/gtest.h>

namespace tarsier::window {
namespace {

TEST(Letterbox, FillsTheScreenAndKeepsTheAspect) {
  const Letterbox wide = fit({640, 480}, {1920, 1080});
  EXPECT_EQ(wide.inside, cv::Rect(240, 0, 1440, 1080));
  const Letterbox tall = fit({1000, 100}, {500, 500});
  EXPECT_EQ(tall.inside, cv::Rect(0, 225, 500, 50));
}

TEST(Letterbox, MapsTheCornersOfTheImage) {
  const Letterbox box = fit({640, 480}, {1920, 1080});
  const cv::Point2d first = box.to_image({240, 0});  // the first of 2.25 window pixels
  EXPECT_NEAR(first.x, -0.28, 0.01);
  EXPECT_NEAR(first.y, -0.28, 0.01);
  const cv::Point2d middle = box.to_image({959.5, 539.5});
  EXPECT_NEAR(middle.x, 319.5, 1e-9);
  EXPECT_NEAR(middle.y, 239.5, 1e-9);
  EXPECT_LT(box.to_image({100, 500}).x, 0) << "beside the image";
}

TEST(Letterbox, IsTheIdentityAtFullSize) {
  const Letterbox box = fit({320, 240}, {320, 240});
  EXPECT_EQ(box.to_image({17, 93}), cv::Point2d(17, 93));
}

TEST(Letterbox, ShrinksImagesThatAreLargerThanTheScreen) {
  EXPECT_EQ(initial_size({640, 480}, {1920, 1080}), cv::Size(640, 480));
  const cv::Size size = initial_size({4000, 3000}, {1920, 1080});
  EXPECT_LE(size.height, 1080);
  EXPECT_NEAR(static_cast<double>(size.width) / size.height, 4.0 / 3, 0.01);
  EXPECT_LE(initial_size({9000, 500}, {3840, 1080}).width, 2060) << "two monitors side by side";
}

TEST(Letterbox, DrawsBlackBars) {
  const cv::Mat image(10, 10, CV_8UC3, cv::Scalar(10, 200, 30));
  cv::Mat canvas;
  compose(image, {40, 20}, canvas);
  EXPECT_EQ(canvas.at<cv::Vec3b>(10, 20), cv::Vec3b(10, 200, 30));
  EXPECT_EQ(canvas.at<cv::Vec3b>(10, 9), cv::Vec3b(0, 0, 0));
  EXPECT_EQ(canvas.at<cv::Vec3b>(10, 30), cv::Vec3b(0, 0, 0));
}

TEST(Letterbox, RefusesEmptySizes) {
  EXPECT_THROW(static_cast<void>(fit({0, 10}, {10, 10})), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::window
