// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/skin.h"

#include "tarsier/core/rng.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

namespace tarsier::cartoon {
namespace {

const cv::Scalar kSkin(120, 150, 210);

TEST(Skin, SeedsAreTheSixPointsOfTheOutline) {
  const auto seeds = skin_seeds({320, 240});
  EXPECT_EQ(seeds[0], cv::Point(160, 80));
  EXPECT_EQ(seeds[1], cv::Point(160 - 29, 80));
  EXPECT_EQ(seeds[3], cv::Point(160, 135));
  EXPECT_EQ(seeds[5], cv::Point(160 + 35, 135));
}

TEST(Skin, EdgesBoundTheFill) {
  // All of one colour: only the edge stops the flood fill.
  cv::Mat painting(120, 160, CV_8UC3, kSkin);
  cv::Mat response = cv::Mat::zeros(240, 320, CV_8UC1);
  cv::circle(response, {160, 120}, 100, 255, 5);
  SkinBuffers buffers;
  const cv::Mat skin = find_skin(painting, response, {}, buffers);
  EXPECT_EQ(skin.at<std::uint8_t>(60, 80), 1);
  EXPECT_EQ(skin.at<std::uint8_t>(5, 5), 0) << "leaked through the edge";
  EXPECT_EQ(skin.at<std::uint8_t>(60, 80 + 50), 0) << "the edge itself is no skin";
}

TEST(Skin, LearnedColorSelectsFaceNotBackground) {
  cv::Mat painting(120, 160, CV_8UC3, cv::Scalar(140, 140, 140));
  cv::ellipse(painting, {80, 60}, {28, 38}, 0, 0, 360, kSkin, cv::FILLED);
  cv::circle(painting, {70, 50}, 4, {20, 20, 20}, cv::FILLED);
  cv::Mat ycrcb;
  cv::cvtColor(painting, ycrcb, cv::COLOR_BGR2YCrCb);
  const cv::Rect face(56, 32, 48, 56);
  SkinBuffers buffers;
  const cv::Mat skin =
      find_skin_of_faces(painting, {face}, {learn_skin_color(ycrcb, face)}, {}, buffers);
  EXPECT_EQ(skin.at<std::uint8_t>(70, 80), 1);
  EXPECT_EQ(skin.at<std::uint8_t>(50, 70), 0) << "an eye is no skin";
  EXPECT_EQ(skin.at<std::uint8_t>(20, 40), 0) << "the wall beside the face is no skin";
}

// Cr and Cb are anticorrelated, as for skin in light and shadow.
TEST(Skin, LearnedColorUsesCovarianceOfCrAndCb) {
  cv::Mat ycrcb(104, 104, CV_8UC3);
  for (int y = 0; y < ycrcb.rows; ++y) {
    for (int x = 0; x < ycrcb.cols; ++x) {
      const int t = (5 * x + 3 * y) % 13 - 6;
      ycrcb.at<cv::Vec3b>(y, x) = {120, static_cast<std::uint8_t>(150 + t),
                                   static_cast<std::uint8_t>(110 - t)};
    }
  }
  const SkinColor color = learn_skin_color(ycrcb, {0, 0, 104, 104});
  EXPECT_NEAR(color.mean[0], 150, 0.3);
  EXPECT_NEAR(color.mean[1], 110, 0.3);
  // Values -6..6 have a variance of 14; 9 is added to both variances.
  const cv::Matx22d expected = cv::Matx22d(14 + 9, -14, -14, 14 + 9).inv();
  for (int k = 0; k < 4; ++k)
    EXPECT_NEAR(color.inverse_covariance.val[k], expected.val[k], 0.004) << k;
}

TEST(Skin, RejectsFaceOutsideImage) {
  const cv::Mat ycrcb(50, 50, CV_8UC3, cv::Scalar::all(128));
  EXPECT_THROW((void)learn_skin_color(ycrcb, {60, 60, 20, 20}), std::invalid_argument);
}

TEST(Skin, GlowAddsTheColour) {
  cv::Mat painting(4, 4, CV_8UC3, cv::Scalar(10, 200, 30));
  cv::Mat skin = cv::Mat::zeros(4, 4, CV_8UC1);
  skin.at<std::uint8_t>(1, 1) = 1;
  color_skin(painting, skin, {});
  EXPECT_EQ(painting.at<cv::Vec3b>(1, 1), cv::Vec3b(10, 255, 30));
  EXPECT_EQ(painting.at<cv::Vec3b>(2, 2), cv::Vec3b(10, 200, 30));
}

TEST(Skin, TintKeepsTheBrightness) {
  cv::Mat painting(2, 2, CV_8UC3, kSkin);
  const cv::Mat skin = cv::Mat::ones(2, 2, CV_8UC1);
  const auto luma = [](const cv::Vec3b& c) { return 0.114 * c[0] + 0.587 * c[1] + 0.299 * c[2]; };
  const double before = luma(painting.at<cv::Vec3b>(0, 0));
  SkinOptions options;
  options.style = SkinStyle::kTint;
  options.color = {60, 120, 20};
  color_skin(painting, skin, options);
  const cv::Vec3b after = painting.at<cv::Vec3b>(0, 0);
  EXPECT_NEAR(luma(after), before, 1);
  EXPECT_GT(after[1], after[2]) << "green now";
}

// Only a part of the image is processed. The limits of this part must not be visible, also at image
// borders. Pixels of the painting outside it are not read.
TEST(Skin, SmoothingMatchesFormulaOverWholeImage) {
  Rng rng(3);
  const cv::Size small(97, 61);
  cv::Mat frame(2 * small.height, 2 * small.width, CV_8UC3);
  cv::Mat painting(frame.size(), CV_8UC3);
  for (int y = 0; y < frame.rows; ++y) {
    for (int i = 0; i < 3 * frame.cols; ++i) {
      frame.ptr(y)[i] = static_cast<std::uint8_t>(rng.integer(0, 255));
      painting.ptr(y)[i] = static_cast<std::uint8_t>(rng.integer(0, 255));
    }
  }
  for (const cv::Rect& face : {cv::Rect(30, 20, 25, 30), cv::Rect(0, 0, 9, 12),
                               cv::Rect(60, 40, 37, 21), cv::Rect(40, 30, 1, 1), cv::Rect()}) {
    cv::Mat skin = cv::Mat::zeros(small, CV_8UC1);
    if (!face.empty()) skin(face).setTo(1);
    cv::Mat weight = skin * 255;
    cv::dilate(weight, weight, cv::Mat());
    cv::erode(weight, weight, cv::Mat());
    cv::blur(weight, weight, {5, 5});
    cv::resize(weight, weight, frame.size(), 0, 0, cv::INTER_LINEAR);
    cv::Mat looked_at(frame.size(), CV_8UC3, cv::Scalar::all(77));
    const cv::Rect area = smoothed_area(skin);
    EXPECT_EQ(area.empty(), face.empty());
    const cv::Rect large(area.tl() * 2, area.size() * 2);
    if (!area.empty()) painting(large).copyTo(looked_at(large));
    SkinBuffers buffers;
    cv::Mat result;
    smooth_skin(frame, looked_at, skin, buffers, result);
    for (int y = 0; y < frame.rows; ++y) {
      for (int i = 0; i < 3 * frame.cols; ++i) {
        const int from = frame.ptr(y)[i];
        const int expected =
            from + ((painting.ptr(y)[i] - from) * weight.ptr(y)[i / 3] + 127) / 255;
        ASSERT_EQ(result.ptr(y)[i], expected) << face << " at " << i / 3 << ", " << y;
      }
    }
  }
}

}  // namespace
}  // namespace tarsier::cartoon
