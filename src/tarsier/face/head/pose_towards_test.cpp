// SPDX-License-Identifier: MIT
#include "tarsier/face/head/head_pose.h"
#include "tarsier/face/head/testing_head.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace tarsier::face::head {
namespace {

double degrees_between(const cv::Matx33d& a, const cv::Matx33d& b) {
  return geometry::angle_of(a * b.t()) * 180 / CV_PI;
}

cv::Vec3d forward_of(const cv::Matx33d& r) { return r * cv::Vec3d(0, 0, -1); }

TEST(PoseTowards, FindsTurnAndPlaceOfTheTrueDirection) {
  const HeadModel model = testing_head(3);
  const HeadPoser poser(model);
  Rng rng(5);
  for (int i = 0; i < 20; ++i) {
    const geometry::Rigid truth = random_pose(rng);
    const Eigen::Matrix2Xd points = picture_of(model.mean, truth, testing_camera(), 0.2, rng);
    // The right direction, turned about itself by some degrees.
    const cv::Matx33d turned = truth.rotation * rotation_of_angles({0, 0, rng.uniform(-20, 20)});
    const HeadPoseResult found = poser.pose_towards(points, testing_camera(), turned);
    ASSERT_TRUE(found.pose) << found.reason;
    EXPECT_LT(degrees_between(found.pose->camera_from_head.rotation, truth.rotation), 1);
    EXPECT_LT(cv::norm(found.pose->camera_from_head.translation - truth.translation), 25);
  }
}

TEST(PoseTowards, KeepsTheDirectionThatItIsGiven) {
  const HeadModel model = testing_head(3);
  const HeadPoser poser(model);
  Rng rng(6);
  for (int i = 0; i < 20; ++i) {
    const geometry::Rigid truth = random_pose(rng);
    const Eigen::Matrix2Xd points = picture_of(model.mean, truth, testing_camera(), 0.5, rng);
    const cv::Matx33d other =
        rotation_of_angles({rng.uniform(-10, 10), rng.uniform(-10, 10), 0}) * truth.rotation;
    const HeadPoseResult found = poser.pose_towards(points, testing_camera(), other);
    ASSERT_TRUE(found.pose) << found.reason;
    const cv::Matx33d& r = found.pose->camera_from_head.rotation;
    EXPECT_LT(cv::norm(forward_of(r) - forward_of(other)), 1e-6);
    // What is drawn there stays on the head: the middle of its points is where theirs is.
    const Eigen::Vector2d drawn = poser.project(*found.pose, testing_camera()).rowwise().mean();
    EXPECT_LT((drawn - points.rowwise().mean()).norm(), 6);
  }
}

TEST(PoseTowards, ChangesNothingThatIsKnownOfThePerson) {
  const HeadModel model = testing_head(3);
  const HeadPoser poser(model);
  Rng rng(7);
  const geometry::Rigid truth = random_pose(rng);
  const Eigen::Matrix2Xd points = picture_of(model.mean, truth, testing_camera(), 0.5, rng);
  HeadIdentity identity;
  ASSERT_TRUE(poser.pose(points, testing_camera(), identity).pose);
  const Eigen::VectorXd before = identity.vector;
  ASSERT_TRUE(poser.pose_towards(points, testing_camera(), truth.rotation, &identity).pose);
  EXPECT_EQ(identity.frames, 1);
  EXPECT_EQ(identity.vector, before);
}

TEST(PoseTowards, RefusesWhatIsNoRotation) {
  const HeadModel model = testing_head(1);
  const HeadPoser poser(model);
  Rng rng(8);
  const Eigen::Matrix2Xd points =
      picture_of(model.mean, random_pose(rng), testing_camera(), 0, rng);
  EXPECT_THROW((void)poser.pose_towards(points, testing_camera(), cv::Matx33d::zeros()),
               std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::head
