// SPDX-License-Identifier: MIT
#include "tarsier/face/head/blink.h"

#include "tarsier/core/rng.h"
#include "tarsier/face/head/testing_eyes.h"

#include <gtest/gtest.h>

#include <stdexcept>
#include <vector>

namespace tarsier::face::head {
namespace {

// Two eyes of 60 px. `open` is the opening of the lids, 1: open. Of the 68 points only those of the
// eyes and the irises matter.
Eigen::Matrix2Xd eyes(double open) {
  constexpr Eigen::Index kIrisPoints = 16;
  Eigen::Matrix2Xd points = Eigen::Matrix2Xd::Zero(2, 68 + 2 * kIrisPoints);
  const double dx[6] = {-30, -10, 10, 30, 10, -10};
  const double dy[6] = {0, -11, -11, 0, 11, 11};
  for (Eigen::Index eye = 0; eye < 2; ++eye) {
    const Eigen::Vector2d center(eye == 0 ? 250 : 390, 240);
    for (Eigen::Index k = 0; k < 6; ++k)
      points.col(36 + 6 * eye + k) = center + Eigen::Vector2d(dx[k], open * dy[k]);
    for (Eigen::Index k = 0; k < kIrisPoints; ++k) {
      const double a = 2 * 3.14159265358979 * static_cast<double>(k) / kIrisPoints;
      points.col(68 + kIrisPoints * eye + k) =
          center + 11 * Eigen::Vector2d(std::cos(a), std::sin(a));
    }
  }
  return points;
}

AffineMap no_motion() { return AffineMap::Identity(); }

EyePatches patches(double open) {
  const Eigen::Matrix2Xd points = eyes(1);
  return eye_patches(test_support::image_of_eyes(eyes(open)), points.leftCols(68), no_motion());
}

// The frames (from 0) in which a detector finds a blink.
std::vector<int> blinks(const std::vector<std::pair<double, EyePatches>>& frames) {
  BlinkDetector detector({});
  std::vector<int> found;
  for (std::size_t i = 0; i < frames.size(); ++i)
    if (detector.step(static_cast<double>(i) / test_support::kFps, frames[i].first,
                      frames[i].second))
      found.push_back(static_cast<int>(i));
  return found;
}

TEST(EyePatchesTest, IsInvariantToAffineMotion) {
  const Eigen::Matrix2Xd points = eyes(1);
  const cv::Mat image = test_support::image_of_eyes(points);
  const EyePatches first = patches(1);
  for (const double squeeze : {1.0, 0.7, 1.3}) {
    AffineMap map;
    map << 0.95, -0.2, 60, 0.18, 0.95 * squeeze, -30;
    cv::Mat motion(2, 3, CV_64F);
    for (int r = 0; r < 2; ++r)
      for (int c = 0; c < 3; ++c) motion.at<double>(r, c) = map(r, c);
    cv::Mat moved;
    cv::warpAffine(image, moved, motion, image.size(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
    moved = 0.6 * moved + 30;  // other light
    const EyePatches second = eye_patches(moved, points.leftCols(68), map);
    EXPECT_GT(first[0].dot(second[0]), 0.97) << squeeze;
    EXPECT_GT(first[1].dot(second[1]), 0.97) << squeeze;
  }
  const EyePatches shut = patches(0.1);
  EXPECT_LT(first[0].dot(shut[0]), 0.7);
}

TEST(EyePatchesTest, AcceptsAnyPositionAndRejectsInvalidInput) {
  const Eigen::Matrix2Xd points = eyes(1).leftCols(68);
  AffineMap away = no_motion();
  away.col(2) << -245, 0;  // one eye at the image's edge
  const cv::Mat image = test_support::image_of_eyes(eyes(1));
  const EyePatches at_edge = eye_patches(image.colRange(245, 640), points, away);
  EXPECT_NEAR(at_edge[0].norm(), 1, 1e-5);
  EXPECT_GT(at_edge[1].dot(patches(1)[1]), 0.999);
  for (const double far : {5e3, 1e8, -1e12}) {
    away.col(2) << far, far;
    EXPECT_EQ(eye_patches(image, points, away)[0].norm(), 0) << far;
  }
  EXPECT_EQ(
      eye_patches(cv::Mat(480, 640, CV_8UC3, cv::Scalar(1, 2, 3)), points, no_motion())[0].norm(),
      0);
  EXPECT_THROW((void)eye_patches(cv::Mat(), points, no_motion()), std::invalid_argument);
  EXPECT_THROW((void)eye_patches(cv::Mat(9, 9, CV_32F), points, no_motion()),
               std::invalid_argument);
  EXPECT_THROW((void)eye_patches(image, points.leftCols(5), no_motion()), std::invalid_argument);
}

TEST(BlinkDetector, FindsEachBlinkOnce) {
  std::vector<std::pair<double, EyePatches>> frames;
  for (int i = 0; i < 45; ++i) {
    const double open = i % 15 == 10 ? 0.5 : i % 15 == 11 ? 0.1 : 1;
    frames.emplace_back(open, patches(open));
  }
  EXPECT_EQ(blinks(frames), (std::vector<int>{12, 27, 42}));
}

TEST(BlinkDetector, DoesNotDependOnHowFarTheLidsAreOpen) {
  for (const double wide : {0.6, 1.0, 1.6}) {  // relative to the reference
    std::vector<std::pair<double, EyePatches>> frames;
    for (int i = 0; i < 20; ++i)
      frames.emplace_back(i == 10 ? 0.8 * wide : wide, patches(i == 10 ? 0.2 : 1));
    EXPECT_EQ(blinks(frames).size(), 1U) << wide;
  }
}

TEST(BlinkDetector, IgnoresNodsOcclusionsAndLongClosures) {
  const EyePatches open = patches(1);
  const EyePatches shut = patches(0.1);
  std::vector<std::pair<double, EyePatches>> nodded;  // the lids nearer, the eyes as ever
  std::vector<std::pair<double, EyePatches>>
      something;                                        // before the eyes, the lids where they were
  std::vector<std::pair<double, EyePatches>> closing;   // and they stay shut
  std::vector<std::pair<double, EyePatches>> sleeping;  // for 1.7 s
  for (int i = 0; i < 60; ++i) {
    nodded.emplace_back(i == 15 ? 0.7 : 1, open);
    something.emplace_back(1, i == 15 ? shut : open);
    closing.emplace_back(i < 15 ? 1 : 0.1, i < 15 ? open : shut);
    sleeping.emplace_back(i < 15 || i > 39 ? 1 : 0.1, i < 15 || i > 39 ? open : shut);
  }
  EXPECT_TRUE(blinks(nodded).empty());
  EXPECT_TRUE(blinks(something).empty());
  EXPECT_TRUE(blinks(closing).empty());
  EXPECT_TRUE(blinks(sleeping).empty());
}

}  // namespace
}  // namespace tarsier::face::head
