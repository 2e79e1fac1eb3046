// SPDX-License-Identifier: MIT
#include "render.h"

#include <Eigen/LU>
#include <gtest/gtest.h>

#include "framing.h"
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace tarsier::sfm {
namespace {

const cv::Vec3b kRed(20, 30, 220);
const cv::Vec3b kBlue(220, 60, 20);

void add_point(Model& model, const Eigen::Vector3d& position, const cv::Vec3b& color) {
  model.points.push_back({position, color, 0.5, {}});
}

// One camera at (0, 0, -8), upright, that looks along z.
Model model_with_camera() {
  Model model;
  geometry::Camera camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 600;
  camera.cx = 319.5;
  camera.cy = 239.5;
  model.cameras.push_back(camera);
  Image view;
  view.name = "one.jpg";
  view.registered = true;
  view.pose.translation = {0, 0, 8};
  model.images.push_back(view);
  return model;
}

void add_plate(Model& model, double z, const cv::Vec3b& color) {
  for (int y = -20; y <= 20; ++y)
    for (int x = -20; x <= 20; ++x) add_point(model, {0.05 * x, 0.05 * y, z}, color);
}

double color_distance(const cv::Vec3b& a, const cv::Vec3b& b) {
  return cv::norm(cv::Vec3d(a) - cv::Vec3d(b));
}

bool same(const cv::Mat& a, const cv::Mat& b) {
  return a.size() == b.size() && cv::norm(a, b, cv::NORM_INF) == 0;
}

TEST(Render, CubeAppearsWhereThePinholePredicts) {
  Model model = model_with_camera();
  for (int i = 0; i < 8; ++i)
    add_point(model, {i & 1 ? 1.0 : -1.0, i & 2 ? 1.0 : -1.0, i & 4 ? 1.0 : -1.0},
              i & 4 ? kBlue : kRed);
  for (const double yaw : {0.0, 25.0, 200.0}) {
    ViewOptions options;
    options.yaw_deg = yaw;
    options.pitch_deg = 10;
    options.point_px = 5;
    options.cameras = false;
    const cv::Mat image = render_model(model, options);
    ASSERT_EQ(image.type(), CV_8UC3);
    ASSERT_EQ(image.size(), options.size);
    const Viewpoint view = viewpoint_of(model, options);
    for (const Point& point : model.points) {
      const auto pixel = view.camera.project(view.pose * point.position);
      ASSERT_TRUE(pixel.has_value());
      const cv::Point at(static_cast<int>(std::lround(pixel->x)),
                         static_cast<int>(std::lround(pixel->y)));
      ASSERT_TRUE(cv::Rect({}, image.size()).contains(at)) << at << " yaw " << yaw;
      EXPECT_LT(color_distance(image.at<cv::Vec3b>(at), point.color), 110) << at << " yaw " << yaw;
    }
  }
}

TEST(Render, TheDefaultViewIsFromTheSideOfTheCameras) {
  Model model = model_with_camera();
  add_plate(model, 0, kRed);
  ViewOptions options;
  options.pitch_deg = 0;
  const Viewpoint view = viewpoint_of(model, options);
  const Eigen::Vector3d eye = view.pose.center();
  EXPECT_LT(eye[2], -1);
  EXPECT_NEAR(eye[0], 0, 1e-9);
  EXPECT_NEAR(eye[1], 0, 1e-9);
  // Image y goes down as in the camera.
  const auto low = view.camera.project(view.pose * Eigen::Vector3d(0, 1, 0));
  const auto right = view.camera.project(view.pose * Eigen::Vector3d(1, 0, 0));
  ASSERT_TRUE(low && right);
  EXPECT_GT(low->y, view.camera.cy + 50);
  EXPECT_GT(right->x, view.camera.cx + 50);
  // From above, and from the right.
  options.pitch_deg = 30;
  EXPECT_LT(viewpoint_of(model, options).pose.center()[1], -0.5);
  options.yaw_deg = 90;
  EXPECT_GT(viewpoint_of(model, options).pose.center()[0], 0.5);
}

TEST(Render, UpFollowsTheOrientationOfTheImages) {
  // The camera was held upright: its pixels are rotated, and down in the scene is right in them.
  Model model = model_with_camera();
  add_plate(model, 0, kRed);
  model.images[0].turns = 1;
  ViewOptions options;
  options.pitch_deg = 0;
  const Viewpoint view = viewpoint_of(model, options);
  const auto low = view.camera.project(view.pose * Eigen::Vector3d(1, 0, 0));
  const auto right = view.camera.project(view.pose * Eigen::Vector3d(0, -1, 0));
  ASSERT_TRUE(low && right);
  EXPECT_GT(low->y, view.camera.cy + 50);
  EXPECT_GT(right->x, view.camera.cx + 50);
}

TEST(Render, NearerPointsHideFartherOnes) {
  Model model = model_with_camera();
  add_plate(model, -1, kRed);
  add_plate(model, 1, kBlue);
  ViewOptions options;
  options.pitch_deg = 0;
  options.point_px = 10;
  options.cameras = false;
  const cv::Point center(options.size.width / 2, options.size.height / 2);
  EXPECT_LT(color_distance(render_model(model, options).at<cv::Vec3b>(center), kRed), 60);
  options.yaw_deg = 180;
  EXPECT_LT(color_distance(render_model(model, options).at<cv::Vec3b>(center), kBlue), 60);
}

TEST(Render, OutliersDoNotChangeTheFraming) {
  Model model = model_with_camera();
  for (int i = 0; i < 3000; ++i)
    add_point(model, {std::sin(0.7 * i), std::cos(1.3 * i), std::sin(2.1 * i)}, kBlue);
  const ViewOptions options;
  const double clean = viewpoint_of(model, options).distance;
  const Eigen::Vector3d center = frame_model(model).center;
  for (int i = 0; i < 20; ++i) add_point(model, {1000.0 + 50 * i, -700, 4000}, kRed);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  add_point(model, {nan, 0, 0}, kRed);
  add_point(model, {std::numeric_limits<double>::infinity(), 0, 0}, kRed);
  EXPECT_NEAR(viewpoint_of(model, options).distance, clean, 0.03 * clean);
  EXPECT_LT((frame_model(model).center - center).norm(), 0.05);
  EXPECT_NO_THROW((void)render_model(model, options));
}

TEST(Render, DistantBackgroundDoesNotShrinkTheSubject) {
  Model model = model_with_camera();
  for (int i = 0; i < 1000; ++i)
    add_point(model, {std::sin(0.7 * i), std::cos(1.3 * i), std::sin(2.1 * i)}, kBlue);
  const Framing statue = frame_model(model, false);
  for (int i = 0; i < 120; ++i) add_point(model, {5 + 0.1 * i, 0, 30}, kRed);
  const Framing both = frame_model(model, false);
  EXPECT_GT(both.scale(), statue.scale());
  EXPECT_LT(both.scale(), 1.8 * statue.scale());
}

TEST(Render, EmptyModelIsPlainBackground) {
  ViewOptions options;
  options.size = {200, 100};
  options.background = {1, 2, 3};
  const cv::Mat image = render_model(Model{}, options);
  EXPECT_TRUE(same(image, cv::Mat(options.size, CV_8UC3, cv::Scalar(1, 2, 3))));
  int frames = 0;
  render_turntable(Model{}, options, 3, [&](int, const cv::Mat&) { ++frames; });
  EXPECT_EQ(frames, 3);
}

TEST(Render, CamerasAreDrawnOnlyOnRequest) {
  Model model = model_with_camera();
  add_plate(model, 0, kBlue);
  ViewOptions options;
  options.yaw_deg = 90;
  options.distance = 30;
  const cv::Mat with = render_model(model, options);
  options.cameras = false;
  const cv::Mat without = render_model(model, options);
  EXPECT_FALSE(same(with, without));
  // The change is around the camera's centre only.
  const Viewpoint view = viewpoint_of(model, options);
  const auto center = view.camera.project(view.pose * model.images[0].pose.center());
  ASSERT_TRUE(center.has_value());
  cv::Mat changed;
  cv::absdiff(with, without, changed);
  changed = changed.reshape(1);
  int near = 0;
  double farthest = 0;
  for (int y = 0; y < changed.rows; ++y) {
    for (int x = 0; x < changed.cols; ++x) {
      if (changed.at<std::uint8_t>(y, x) == 0) continue;
      ++near;
      farthest = std::max(farthest, std::hypot(x / 3 - center->x, y - center->y));
    }
  }
  EXPECT_GT(near, 30);
  EXPECT_LT(farthest, 100);
  model.images[0].registered = false;
  EXPECT_TRUE(camera_pyramids(model, frame_model(model)).empty());
}

TEST(Render, CamerasAllAroundStillGiveAFrame) {
  Model model;
  for (int i = 0; i < 8; ++i) {
    const double a = 2 * std::numbers::pi * i / 8;
    Image view;
    view.registered = true;
    view.camera = 7;  // does not exist
    view.pose.rotation = geometry::rotation_by({0, a, 0});
    view.pose.translation = {0, 0, 5};
    model.images.push_back(view);
  }
  add_plate(model, 0, kRed);
  const Framing framing = frame_model(model);
  EXPECT_NEAR((framing.base * framing.base.transpose() - Eigen::Matrix3d::Identity()).norm(), 0,
              1e-9);
  EXPECT_NEAR(framing.base.determinant(), 1, 1e-9);
  EXPECT_NEAR(framing.base(1, 1), -1, 1e-9);
  EXPECT_EQ(camera_pyramids(model, framing).size(), 8U);
  EXPECT_NO_THROW((void)render_model(model, {}));
}

TEST(Turntable, ComesBackToItsFirstFrame) {
  Model model = model_with_camera();
  add_plate(model, 0.5, kBlue);
  add_plate(model, -0.2, kRed);
  ViewOptions options;
  options.size = {320, 240};
  options.yaw_deg = 33;
  std::vector<cv::Mat> frames;
  render_turntable(model, options, 5, [&](int number, const cv::Mat& image) {
    EXPECT_EQ(number, static_cast<int>(frames.size()));
    frames.push_back(image.clone());
  });
  ASSERT_EQ(frames.size(), 5U);
  EXPECT_TRUE(same(frames[0], render_model(model, options)));
  ViewOptions around = options;
  around.yaw_deg += 360;
  EXPECT_TRUE(same(frames[0], render_model(model, around)));
  EXPECT_FALSE(same(frames[0], frames[1]));
}

TEST(Render, RefusesBadOptions) {
  ViewOptions options;
  options.pitch_deg = 90;
  EXPECT_THROW((void)render_model(Model{}, options), std::invalid_argument);
  options = {};
  options.size = {0, 100};
  EXPECT_THROW((void)render_model(Model{}, options), std::invalid_argument);
  options = {};
  options.distance = -1;
  EXPECT_THROW((void)render_model(Model{}, options), std::invalid_argument);
  EXPECT_THROW(render_turntable(Model{}, {}, 0, [](int, const cv::Mat&) {}), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::sfm
