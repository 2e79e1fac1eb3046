// SPDX-License-Identifier: MIT
#include "tarsier/face/head_view/head_view.h"

#include "tarsier/face/head_view/testing_view.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <cmath>

namespace tarsier::face::head_view {
namespace {

TEST(HeadView, HeadAtBorderFacingTheCameraHasZeroYaw) {
  const geometry::Camera camera = testing_camera();
  geometry::Rigid3 pose{Eigen::Matrix3d::Identity(), {150, 0, 700}};
  const Eigen::Vector3d middle = pose * Eigen::Vector3d(0, 30, 40);
  const double bearing_deg = std::atan2(middle[0], middle[2]) * 180 / CV_PI;
  // The head looks towards the camera. It is at image right, so it is rotated to image left.
  pose.rotation = head::rotation_of_angles({bearing_deg, 0, 0});
  const auto view = view_of_painted(painted_head(pose, camera), camera, pose);
  ASSERT_TRUE(view);
  EXPECT_NEAR(view->angles.yaw_deg, 0, 1);
  EXPECT_GT(bearing_deg, 10);
}

TEST(HeadView, GradientsAreInvariantToRollAndDistance) {
  const geometry::Camera camera = testing_camera();
  const auto seen = [&](double roll, double distance) {
    const geometry::Rigid3 pose{head::rotation_of_angles({15, -10, roll}), {0, -20, distance}};
    return view_of_painted(painted_head(pose, camera), camera, pose)->gradients;
  };
  const Eigen::VectorXf upright = seen(0, 500);
  const geometry::Rigid3 other{head::rotation_of_angles({-25, 15, 0}), {0, -20, 500}};
  const float other_view_distance =
      (view_of_painted(painted_head(other, camera), camera, other)->gradients - upright).norm();
  EXPECT_LT((seen(25, 500) - upright).norm(), 0.4F * other_view_distance);
  EXPECT_LT((seen(0, 650) - upright).norm(), 0.4F * other_view_distance);
}

TEST(HeadView, MirroredViewMatchesMirroredImage) {
  const geometry::Camera camera = testing_camera();
  const geometry::Rigid3 pose{head::rotation_of_angles({20, 8, 12}), {30, -20, 550}};
  const cv::Mat image = painted_head(pose, camera);
  // The landmarks are wrong: they are those of a head with a smaller rotation.
  const geometry::Rigid3 wrong_pose{head::rotation_of_angles({14, 4, 12}), {30, -20, 550}};
  const HeadView view = mirrored(*view_of_painted(image, camera, pose, &wrong_pose));
  cv::Mat flipped;
  cv::flip(image, flipped, 1);
  const geometry::Rigid3 mirror{head::rotation_of_angles({-20, 8, -12}), {-30, -20, 550}};
  const geometry::Rigid3 mirror_wrong_pose{head::rotation_of_angles({-14, 4, -12}),
                                           {-30, -20, 550}};
  const HeadView truth = *view_of_painted(flipped, camera, mirror, &mirror_wrong_pose);
  EXPECT_NEAR(view.angles.yaw_deg, truth.angles.yaw_deg, 1e-6);
  EXPECT_NEAR(view.angles.roll_deg, truth.angles.roll_deg, 1e-6);
  EXPECT_LT((view.camera_from_view - truth.camera_from_view).norm(), 1e-9);
  EXPECT_LT((view.gradients - truth.gradients).norm(), 0.05F * truth.gradients.norm());
  ASSERT_EQ(view.offsets.size(), 2 * testing_points().points());
  EXPECT_LT((view.offsets - truth.offsets).norm(), 1e-3F);
  EXPECT_LT((view.mirrored_offsets - truth.mirrored_offsets).norm(), 1e-3F);
  EXPECT_GT((view.offsets - view.mirrored_offsets).norm(), 1);
}

TEST(HeadView, OffsetsAreInMillimetresOfTheUprightHead) {
  const geometry::Camera camera = testing_camera();
  // The landmarks are those of a displaced head: 10 mm to image left, 20 mm down.
  const geometry::Rigid3 rough{head::rotation_of_angles({0, 0, 30}), {0, 0, 2000}};
  geometry::Rigid3 truth = rough;
  truth.translation += rough.rotation * Eigen::Vector3d(-10, 20, 0);
  const auto view = view_of_head(painted_head(truth, camera), camera, rough, testing_points(),
                                 projected_points(truth, camera));
  ASSERT_TRUE(view);
  for (Eigen::Index i = 0; i < testing_points().points(); ++i) {
    EXPECT_NEAR(view->offsets[2 * i], -10, 1);
    EXPECT_NEAR(view->offsets[2 * i + 1], 20, 2);
  }
}

TEST(HeadView, HeadModelWithoutMirrorGivesNoOffsets) {
  const geometry::Camera camera = testing_camera();
  const geometry::Rigid3 pose{Eigen::Matrix3d::Identity(), {0, 0, 600}};
  head::HeadModel head = testing_points();
  head.mirror.clear();
  const auto view =
      view_of_head(painted_head(pose, camera), camera, pose, head, projected_points(pose, camera));
  ASSERT_TRUE(view);
  EXPECT_EQ(view->offsets.size(), 0);
}

TEST(HeadView, DirectionRoundTrip) {
  const geometry::Camera camera = testing_camera();
  const geometry::Rigid3 pose{head::rotation_of_angles({20, 8, 30}), {60, -20, 550}};
  const HeadView view = *view_of_painted(painted_head(pose, camera), camera, pose);
  // The direction of the pose is that of its angles, and gives the pose's rotation.
  const Eigen::Vector3d forward = pose.rotation * Eigen::Vector3d(0, 0, -1);
  const Direction own = direction_of(view, view.camera_from_view.transpose() * forward);
  EXPECT_NEAR(own.pitch_deg, view.angles.pitch_deg, 1e-9);
  EXPECT_NEAR(own.yaw_deg, view.angles.yaw_deg, 1e-9);
  EXPECT_LT((rotation_towards(view, own) - pose.rotation).norm(), 1e-9);
  // For any other direction, the returned rotation has this direction.
  const Direction other{-17, 40};
  const Eigen::Vector3d there = view.camera_from_view.transpose() *
                                (rotation_towards(view, other) * Eigen::Vector3d(0, 0, -1));
  EXPECT_NEAR(direction_of(view, there).pitch_deg, -17, 1e-9);
  EXPECT_NEAR(direction_of(view, there).yaw_deg, 40, 1e-9);
}

TEST(HeadView, GradientsEncodeTheDirectionOfLines) {
  cv::Mat crop(kSide, kSide, CV_8UC1);
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) crop.at<std::uint8_t>(y, x) = x % 8 < 4 ? 60 : 160;
  const Eigen::VectorXf upright = gradients_of(crop);
  const Eigen::Index cell_start = (3 * kCells + 3) * kOrientations;
  EXPECT_GT(upright[cell_start], 0.15F);
  EXPECT_NEAR(upright.segment(cell_start + 1, kOrientations - 1).sum(), 0, 1e-6);
  // A flat image has no gradients; a factor on the brightness changes little.
  EXPECT_EQ(gradients_of(cv::Mat(kSide, kSide, CV_8UC1, cv::Scalar(99))).norm(), 0);
  const cv::Mat darker = crop / 2;
  EXPECT_LT((gradients_of(darker) - upright).norm(), 0.02F * upright.norm());
}

TEST(HeadView, RejectsInvisibleHeadsAndInvalidImages) {
  const geometry::Camera camera = testing_camera();
  const cv::Mat gray(camera.height, camera.width, CV_8UC1, cv::Scalar(0));
  const head::HeadModel head = testing_points();
  const Eigen::Matrix2Xd points = Eigen::Matrix2Xd::Zero(2, head.points());
  const auto seen = [&](double z) {
    return view_of_head(gray, camera, {Eigen::Matrix3d::Identity(), {0, 0, z}}, head, points);
  };
  EXPECT_TRUE(seen(500));
  EXPECT_FALSE(seen(-500));
  EXPECT_FALSE(seen(50'000));  // too small
  EXPECT_THROW((void)view_of_head(cv::Mat(9, 9, CV_8UC3), camera, {}, head, points),
               std::invalid_argument);
  EXPECT_THROW((void)view_of_head(gray, camera, {}, head, Eigen::Matrix2Xd::Zero(2, 3)),
               std::invalid_argument);
  EXPECT_THROW((void)gradients_of(cv::Mat(9, 9, CV_8UC1)), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::head_view
