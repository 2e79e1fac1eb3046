// SPDX-License-Identifier: MIT
#include "tarsier/sfm/two_view/focal_estimation.h"

#include "tarsier/sfm/two_view/testing_camera_path.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <cmath>
#include <vector>

namespace tarsier::sfm {
namespace {

using Eigen::Vector3d;

TEST(FocalEstimation, FindsTheFocalLengthFromPairs) {
  for (const double known : {250.0, 800.0, 1200.0}) {
    const std::vector<FocalEstimate> found = CameraPath(known).estimate();
    ASSERT_EQ(found.size(), 1U) << known;
    EXPECT_NEAR(found[0].focal_px, kTrueFocal, 0.04 * kTrueFocal) << known;
    EXPECT_EQ(found[0].pairs, 15);
  }
}

TEST(FocalEstimation, IsTheSameForAnyNumberOfThreads) {
  const CameraPath scene(800);
  cv::setNumThreads(1);
  const std::vector<FocalEstimate> one = scene.estimate();
  cv::setNumThreads(3);
  const std::vector<FocalEstimate> three = scene.estimate();
  cv::setNumThreads(-1);
  ASSERT_EQ(one.size(), 1U);
  ASSERT_EQ(three.size(), 1U);
  EXPECT_EQ(one[0].focal_px, three[0].focal_px);
}

TEST(FocalEstimation, SkipsKnownLens) {
  const CameraPath scene(800);
  EXPECT_TRUE(
      estimate_focal_lengths(scene.cameras, {0}, scene.images, scene.pairs, kThresholdPx, {})
          .empty());
}

TEST(FocalEstimation, IsEmptyForPlanarScene) {
  EXPECT_TRUE(CameraPath(800, true).estimate().empty());
}

TEST(FocalEstimation, IsEmptyForFewPairs) {
  CameraPath scene(800);
  scene.pairs.resize(4);
  EXPECT_TRUE(scene.estimate().empty());
}

// Images 0 to 2 have a known lens, the others an unknown one.
TEST(FocalEstimation, UsesPairsWithAKnownLens) {
  CameraPath scene(800);
  scene.cameras.push_back(scene.cameras[0]);
  scene.cameras[0].fx = scene.cameras[0].fy = kTrueFocal;
  for (std::size_t i = 3; i < 6; ++i) scene.images[i].camera = 1;
  const std::vector<FocalEstimate> found =
      estimate_focal_lengths(scene.cameras, {0, 1}, scene.images, scene.pairs, kThresholdPx, {});
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].camera, 1);
  EXPECT_EQ(found[0].pairs, 12);  // all pairs except those of the known lens alone
  EXPECT_NEAR(found[0].focal_px, kTrueFocal, 0.04 * kTrueFocal);
}

// Each image has its own camera. No camera has five pairs of its own, but all pairs together give
// the factor.
TEST(FocalEstimation, CamerasWithFewPairsTakeCommonFactor) {
  CameraPath scene(800);
  scene.cameras.resize(6, scene.cameras[0]);
  for (int i = 0; i < 6; ++i) scene.images[static_cast<std::size_t>(i)].camera = i;
  const std::vector<FocalEstimate> found = scene.estimate();
  ASSERT_EQ(found.size(), 6U);
  for (const FocalEstimate& each : found) EXPECT_NEAR(each.focal_px, kTrueFocal, 0.04 * kTrueFocal);
}

TEST(FocalEstimation, MotionIsCorrectWithKnownFocalLength) {
  CameraPath scene(800);
  const Pair& pair = scene.pairs[3];  // of images 0 and 4
  const geometry::Rigid3 truth = scene.images[4].pose * scene.images[0].pose.inverse();
  const auto rotation_error = [&](const TwoView& view) {
    return geometry::angle_of(truth.rotation * view.second_from_first.rotation.transpose());
  };
  TwoView view = pair.view;
  const geometry::Camera right{
      .width = 640, .height = 480, .fx = kTrueFocal, .fy = kTrueFocal, .cx = 320, .cy = 240};
  estimate_motion_again(scene.images[0].features, scene.images[4].features, right, right, {}, view);
  EXPECT_EQ(view.inliers, pair.view.inliers);
  EXPECT_LT(rotation_error(view), 0.01);
  EXPECT_GT(rotation_error(pair.view), 5 * rotation_error(view));
  EXPECT_GT(view.second_from_first.translation.dot(truth.translation.normalized()), 0.999);
}

}  // namespace
}  // namespace tarsier::sfm
