// SPDX-License-Identifier: MIT
#include "tarsier/face/head/head_pose.h"
#include "tarsier/face/head/testing_head.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace tarsier::face::head {
namespace {

Eigen::Vector3d forward_of(const Eigen::Matrix3d& r) { return r * Eigen::Vector3d(0, 0, -1); }

TEST(PoseTowards, RecoversRollAndTranslation) {
  const HeadModel model = testing_head(3);
  const HeadPoseEstimator estimator(model);
  Rng rng(5);
  for (int i = 0; i < 20; ++i) {
    const geometry::Rigid3 truth = random_pose(rng);
    const Eigen::Matrix2Xd points = image_of(model.mean, truth, testing_camera(), 0.2, rng);
    // The true direction, rotated about its own axis by some degrees.
    const Eigen::Matrix3d turned =
        truth.rotation * rotation_of_angles({0, 0, rng.uniform(-20, 20)});
    const HeadPoseResult found = estimator.pose_towards(points, testing_camera(), turned);
    ASSERT_TRUE(found.pose) << found.reason;
    EXPECT_LT(degrees_between(found.pose->camera_from_head, truth), 1);
    EXPECT_LT((found.pose->camera_from_head.translation - truth.translation).norm(), 25);
  }
}

TEST(PoseTowards, KeepsTheGivenDirection) {
  const HeadModel model = testing_head(3);
  const HeadPoseEstimator estimator(model);
  Rng rng(6);
  for (int i = 0; i < 20; ++i) {
    const geometry::Rigid3 truth = random_pose(rng);
    const Eigen::Matrix2Xd points = image_of(model.mean, truth, testing_camera(), 0.5, rng);
    const Eigen::Matrix3d other =
        rotation_of_angles({rng.uniform(-10, 10), rng.uniform(-10, 10), 0}) * truth.rotation;
    const HeadPoseResult found = estimator.pose_towards(points, testing_camera(), other);
    ASSERT_TRUE(found.pose) << found.reason;
    const Eigen::Matrix3d& r = found.pose->camera_from_head.rotation;
    EXPECT_LT((forward_of(r) - forward_of(other)).norm(), 1e-6);
    // A drawn head stays on the face: the middle of its projected points is near the middle of the
    // given points.
    const Eigen::Vector2d drawn = estimator.project(*found.pose, testing_camera()).rowwise().mean();
    EXPECT_LT((drawn - points.rowwise().mean()).norm(), 6);
  }
}

TEST(PoseTowards, DoesNotChangeTheIdentity) {
  const HeadModel model = testing_head(3);
  const HeadPoseEstimator estimator(model);
  Rng rng(7);
  const geometry::Rigid3 truth = random_pose(rng);
  const Eigen::Matrix2Xd points = image_of(model.mean, truth, testing_camera(), 0.5, rng);
  HeadIdentity identity;
  ASSERT_TRUE(estimator.pose(points, testing_camera(), identity).pose);
  const Eigen::VectorXd before = identity.vector;
  ASSERT_TRUE(estimator.pose_towards(points, testing_camera(), truth.rotation, &identity).pose);
  EXPECT_EQ(identity.frames, 1);
  EXPECT_EQ(identity.vector, before);
}

TEST(PoseTowards, RejectsInvalidRotation) {
  const HeadModel model = testing_head(1);
  const HeadPoseEstimator estimator(model);
  Rng rng(8);
  const Eigen::Matrix2Xd points = image_of(model.mean, random_pose(rng), testing_camera(), 0, rng);
  EXPECT_THROW((void)estimator.pose_towards(points, testing_camera(), Eigen::Matrix3d::Zero()),
               std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::head
