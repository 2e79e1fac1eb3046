// SPDX-License-Identifier: MIT
#include "tarsier/plate/site/motion.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace tarsier::plate {
namespace {

// A street with noise of 4 grey levels. A vehicle is at `x` if x >= 0. `light` is added everywhere.
cv::Mat street(int x, int frame, double light = 0) {
  cv::Mat image(360, 640, CV_8UC3, cv::Scalar::all(100));
  if (x >= 0) cv::rectangle(image, {x, 200, 40, 24}, {70, 70, 70}, cv::FILLED);
  cv::Mat noise(image.size(), CV_16SC3);
  cv::RNG random(static_cast<std::uint64_t>(frame) + 7);
  random.fill(noise, cv::RNG::NORMAL, 0, 4);
  cv::Mat sum;
  image.convertTo(sum, CV_16SC3, 1, light);
  sum += noise;
  sum.convertTo(image, CV_8UC3);
  return image;
}

class Motion : public testing::Test {
 protected:
  bool moves(int x, double light = 0) {
    return has_motion(options_, state_, street(x, frame_++, light));
  }
  MotionOptions options_;
  MotionState state_;
  int frame_ = 0;
};

TEST_F(Motion, DetectsVehiclesButNotNoise) {
  EXPECT_TRUE(moves(-1));  // the first frame
  for (int k = 0; k < 20; ++k) EXPECT_FALSE(moves(-1)) << k;
  for (int k = 0; k < 10; ++k) EXPECT_TRUE(moves(40 * k)) << k;
}

TEST_F(Motion, IgnoresGlobalBrightnessChanges) {
  for (int k = 0; k < 10; ++k) static_cast<void>(moves(-1));
  for (int k = 0; k < 10; ++k) EXPECT_FALSE(moves(-1, 3.0 * k)) << k;
  EXPECT_TRUE(moves(100, 30));
}

TEST_F(Motion, EndsAfterAnObjectStops) {
  for (int k = 0; k < 10; ++k) static_cast<void>(moves(-1));
  int moving = 0;
  for (int k = 0; k < 300; ++k) moving += moves(200) ? 1 : 0;
  EXPECT_GT(moving, 20);
  EXPECT_LT(moving, 200);
  EXPECT_FALSE(moves(200));
  EXPECT_TRUE(moves(240));  // it drives away
}

TEST_F(Motion, BoxCoversRecentMotion) {
  const cv::Size size(640, 360);
  EXPECT_EQ(motion_box(state_, 0, size), cv::Rect({0, 0}, size));  // no background yet
  const auto moves_at = [&](int x, double time) {
    return has_motion(options_, state_, street(x, frame_++), time);
  };
  for (int k = 0; k < 10; ++k) static_cast<void>(moves_at(-1, 0.1 * k));
  EXPECT_EQ(motion_box(state_, 0, size), cv::Rect({0, 0}, size));  // the first frame
  EXPECT_TRUE(motion_box(state_, 0.5, size).empty());
  ASSERT_TRUE(moves_at(200, 1.5));
  const cv::Rect around = motion_box(state_, 1.2, size);
  EXPECT_EQ(around & cv::Rect(200, 200, 40, 24), cv::Rect(200, 200, 40, 24));
  EXPECT_LT(around.area(), 100 * 80);
  ASSERT_TRUE(moves_at(600, 2.5));
  const cv::Rect last = motion_box(state_, 2, size);
  EXPECT_EQ(last.br().x, 640);  // clipped to the image
  EXPECT_GT(last.x, 500);
  const cv::Rect both = motion_box(state_, 1.2, size);
  EXPECT_EQ(both, around | last);
  EXPECT_EQ(motion_box(state_, 1.2, {1280, 720}).height, 2 * both.height);
}

TEST_F(Motion, ThresholdZeroReportsEveryFrame) {
  options_.threshold = 0;
  for (int k = 0; k < 5; ++k) EXPECT_TRUE(moves(-1));
}

TEST_F(Motion, RestartsWhenTheImageSizeChanges) {
  for (int k = 0; k < 5; ++k) static_cast<void>(moves(-1));
  EXPECT_TRUE(has_motion(options_, state_, cv::Mat(100, 640, CV_8UC1, cv::Scalar(100))));
  EXPECT_THROW((void)has_motion(options_, state_, cv::Mat()), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::plate
