// SPDX-License-Identifier: MIT
#include "tarsier/geometry/scaled_camera.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace tarsier::geometry {
namespace {

TEST(ScaledCamera, SeesTheSameThroughAnImageOfHalfTheSize) {
  Camera camera = guessed_camera({640, 480});
  camera.cx = 300;
  camera.distortion = {-0.2, 0.1, 0, 0, 0};
  const auto half = scaled_camera(camera, {320, 240});
  ASSERT_TRUE(half);
  const Eigen::Vector3d x(0.2, -0.1, 1);
  const cv::Point2d p = *camera.project(x);
  const cv::Point2d q = *half->project(x);
  EXPECT_NEAR((q.x + 0.5) * 2, p.x + 0.5, 1e-9);
  EXPECT_NEAR((q.y + 0.5) * 2, p.y + 0.5, 1e-9);
  EXPECT_FALSE(scaled_camera(camera, {640, 360}));
  camera.width = camera.height = 0;  // not known
  EXPECT_EQ(scaled_camera(camera, {640, 360})->fx, camera.fx);
}

TEST(ScaledCamera, AcceptsTheRoundingOfFlatImages) {
  // Half of a pixel is 1.2 % of 41 px.
  EXPECT_TRUE(scaled_camera(guessed_camera({1280, 162}), {320, 41}));
  EXPECT_TRUE(scaled_camera(guessed_camera({162, 1280}), {41, 320}));
  EXPECT_TRUE(scaled_camera(guessed_camera({320, 41}), {1280, 162}));
  EXPECT_FALSE(scaled_camera(guessed_camera({1280, 162}), {320, 42}));
  EXPECT_FALSE(scaled_camera(guessed_camera({320, 42}), {1280, 162}));
}

TEST(GuessedCamera, HasItsPrincipalPointAtTheCenter) {
  const Camera camera = guessed_camera({480, 640});
  camera.check();
  EXPECT_EQ(camera.fx, 640);
  EXPECT_EQ(camera.cx, 239.5);
  EXPECT_THROW((void)guessed_camera({0, 4}), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::geometry
