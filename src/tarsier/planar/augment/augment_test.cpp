// SPDX-License-Identifier: MIT
#include "tarsier/planar/augment/augment.h"

#include "tarsier/render/builtin.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <stdexcept>
#include <vector>

namespace tarsier::planar::augment {
namespace {

geometry::Camera test_camera() {
  geometry::Camera camera;
  camera.width = 320;
  camera.height = 240;
  camera.fx = camera.fy = 300;
  camera.cx = 159.5;
  camera.cy = 119.5;
  return camera;
}

cv::Mat paper() { return {240, 320, CV_8UC3, cv::Scalar::all(200)}; }

// Seen from 50 degrees off the normal, with the far edge at the top of the image.
Sheet sheet_at(const Eigen::Vector3d& at, int key = 0, double tilt_deg = 50) {
  const double c = std::cos(tilt_deg * CV_PI / 180);
  const double s = std::sin(tilt_deg * CV_PI / 180);
  // The sheet's y axis points away from the camera.
  return {key, {Eigen::Matrix3d{{1, 0, 0}, {0, -c, -s}, {0, s, -c}}, at}, 0.05};
}

cv::Vec3b at(const cv::Mat& image, const geometry::Camera& camera, const Sheet& sheet,
             const Eigen::Vector3d& on_sheet) {
  const auto p = camera.project(sheet.camera_from_sheet * on_sheet).value();
  return image.at<cv::Vec3b>(cvRound(p.y), cvRound(p.x));
}

const cv::Vec3b kPaper(200, 200, 200);

TEST(Augment, TheCubeStandsOnTheSheet) {
  const geometry::Camera camera = test_camera();
  const Sheet sheet = sheet_at({0, 0, 0.3});
  cv::Mat image = paper();
  AugmentState state;
  AugmentOptions options;
  options.shadow = false;
  augment(image, camera, std::vector{sheet}, options, state);
  // Its top face and its front are drawn. Nothing is drawn below the sheet or beside the marker.
  EXPECT_NE(at(image, camera, sheet, {0, 0, 0.05}), kPaper);
  EXPECT_NE(at(image, camera, sheet, {0, -0.025, 0.02}), kPaper);
  EXPECT_EQ(at(image, camera, sheet, {0, -0.03, -0.005}), kPaper);
  EXPECT_EQ(at(image, camera, sheet, {0.035, 0, 0}), kPaper);
}

TEST(Augment, HidesPartsBelowSheet) {
  const geometry::Camera camera = test_camera();
  const Sheet sheet = sheet_at({0, 0, 0.3});
  render::Mesh ball = render::make_sphere(24, {0.1F, 0.1F, 0.9F});  // its centre lies on the sheet
  for (cv::Vec3f& p : ball.positions) p *= 0.4F;
  AugmentOptions options;
  options.object = Object::kMesh;
  options.mesh = std::make_shared<const render::Mesh>(ball);
  options.shadow = false;
  AugmentState state;
  cv::Mat image = paper();
  augment(image, camera, std::vector{sheet}, options, state);
  EXPECT_NE(at(image, camera, sheet, {0, 0, 0.018}), kPaper);
  // The lower half of the ball would be here if it were seen through the sheet.
  const auto low =
      camera.project(sheet.camera_from_sheet * Eigen::Vector3d(0, -0.004, -0.016)).value();
  EXPECT_EQ(image.at<cv::Vec3b>(cvRound(low.y), cvRound(low.x)), kPaper);
}

TEST(Augment, TheShadowLiesOnTheSheetAwayFromTheLight) {
  const geometry::Camera camera = test_camera();
  const Sheet sheet = sheet_at({0, 0, 0.3}, 4, 20);
  AugmentState state;
  state.light_in_anchor = {1, 0, -1};  // the light travels to the sheet's right
  AugmentOptions options;
  cv::Mat image = paper();
  augment(image, camera, std::vector{sheet}, options, state);
  const cv::Vec3b shadow = at(image, camera, sheet, {0.05, 0, 0});
  EXPECT_LT(shadow[0], 150);
  EXPECT_EQ(shadow[0], shadow[2]);  // darker paper without colour
  EXPECT_EQ(at(image, camera, sheet, {-0.045, 0, 0}), kPaper);
  EXPECT_EQ(at(image, camera, sheet, {0.09, 0, 0}), kPaper);
}

TEST(Augment, DepthOrderIsIndependentOfInputOrder) {
  const geometry::Camera camera = test_camera();
  const Sheet near = sheet_at({0, 0.02, 0.3}, 1);
  const Sheet far = sheet_at({0.01, -0.02, 0.38}, 2);
  AugmentOptions options;
  AugmentState state;
  cv::Mat one = paper();
  augment(one, camera, std::vector{near, far}, options, state);
  state = {};
  cv::Mat other = paper();
  augment(other, camera, std::vector{far, near}, options, state);
  EXPECT_EQ(cv::norm(one, other, cv::NORM_INF), 0);
  cv::Mat alone = paper();
  state = {};
  augment(alone, camera, std::vector{near}, options, state);
  EXPECT_EQ(at(one, camera, near, {0, -0.025, 0.03}), at(alone, camera, near, {0, -0.025, 0.03}));
}

TEST(Augment, KeepsLightWhenAnchorSheetIsLost) {
  const geometry::Camera camera = test_camera();
  const Sheet a = sheet_at({-0.05, 0, 0.3}, 1);
  Sheet b = sheet_at({0.05, 0, 0.3}, 2);
  // Rotated on the same desk.
  b.camera_from_sheet.rotation =
      b.camera_from_sheet.rotation * Eigen::Matrix3d{{0, -1, 0}, {1, 0, 0}, {0, 0, 1}};
  AugmentState state;
  cv::Mat image = paper();
  augment(image, camera, std::vector{a, b}, {}, state);
  const Eigen::Vector3d before = state.light_in_camera;
  augment(image, camera, std::vector{b}, {}, state);
  EXPECT_EQ(state.anchor, 2);
  EXPECT_LT((state.light_in_camera - before).norm(), 1e-9);
}

TEST(UprightMesh, StandsUprightAtCenter) {
  render::Mesh tower = render::make_cube();  // y up: 1 wide, 4 high
  for (cv::Vec3f& p : tower.positions) p = {p[0] + 7, 4 * p[1] - 3, p[2]};
  const render::Mesh mesh = upright_mesh(tower);
  const render::Bounds box = render::bounds_of(mesh);
  EXPECT_NEAR(box.low[2], 0, 1e-5);
  EXPECT_NEAR(box.high[2], 1.5, 1e-5);
  EXPECT_NEAR(box.high[0], 1.5 / 8, 1e-5);
  EXPECT_NEAR(box.low[0], -1.5 / 8, 1e-5);
  EXPECT_NEAR(render::bounds_of(upright_mesh(tower, Up::kZ)).high[2], 0.25, 1e-5);
  EXPECT_THROW((void)upright_mesh(render::Mesh{}), std::invalid_argument);
  AugmentOptions options;
  options.object = Object::kMesh;
  EXPECT_THROW(options.check(), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::planar::augment
