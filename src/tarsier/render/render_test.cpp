// SPDX-License-Identifier: MIT
#include "tarsier/render/render.h"

#include "tarsier/core/rng.h"
#include "tarsier/geometry/opencv_types.h"
#include "tarsier/render/builtin.h"
#include "tarsier/render/testing_scene.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <limits>

namespace tarsier::render {
namespace {

const cv::Vec3f kRed{0, 0, 1};
const cv::Vec3f kGreen{0, 1, 0};
const cv::Vec3b kRedPixel{0, 0, 255};
const cv::Vec3b kGreenPixel{0, 255, 0};
const cv::Vec3b kGround{100, 100, 100};

Eigen::Matrix3d turned(double x, double y, double z) {
  const Eigen::Matrix3d rx{
      {1, 0, 0}, {0, std::cos(x), -std::sin(x)}, {0, std::sin(x), std::cos(x)}};
  const Eigen::Matrix3d ry{
      {std::cos(y), 0, std::sin(y)}, {0, 1, 0}, {-std::sin(y), 0, std::cos(y)}};
  const Eigen::Matrix3d rz{
      {std::cos(z), -std::sin(z), 0}, {std::sin(z), std::cos(z), 0}, {0, 0, 1}};
  return rz * ry * rx;
}

cv::Mat drawn(const Scene& scene, const geometry::Camera& camera) {
  cv::Mat image = gray_background(camera);
  render(image, scene, camera);
  return image;
}

cv::Vec3b at(const cv::Mat& image, int x, int y) { return image.at<cv::Vec3b>(y, x); }

TEST(Render, NearerSurfacesHideFartherOnesInAnyOrder) {
  const geometry::Camera camera = testing_camera();
  Scene scene = plain_scene();
  scene.items = {item_of(square(kRed), {0, 0, 5}), item_of(square(kGreen), {0.5, 0, 6})};
  const cv::Mat one = drawn(scene, camera);
  std::swap(scene.items[0], scene.items[1]);
  const cv::Mat other = drawn(scene, camera);
  EXPECT_EQ(cv::norm(one, other, cv::NORM_INF), 0);
  EXPECT_EQ(at(one, 160, 120), kRedPixel);
  EXPECT_EQ(at(one, 230, 120), kGreenPixel);  // right of the red square (100 .. 219)
  EXPECT_EQ(at(one, 300, 120), kGround);
}

TEST(Render, CrossingSurfacesMeetWhereTheirDepthsAreEqual) {
  const geometry::Camera camera = testing_camera();
  Scene scene = plain_scene();
  // Both rotated about the vertical axis through (0, 0, 5), one to the left, one to the right.
  scene.items = {item_of(square(kRed), {0, 0, 5}, turned(0, 0.5, 0)),
                 item_of(square(kGreen), {0, 0, 5}, turned(0, -0.5, 0))};
  const cv::Mat image = drawn(scene, camera);
  // Rotated by +0.5 about y, the right end is nearer (z = -x sin).
  for (int y = 100; y < 140; ++y) {
    EXPECT_EQ(at(image, 161, y), kRedPixel) << y;
    EXPECT_EQ(at(image, 158, y), kGreenPixel) << y;
  }
}

TEST(Render, ACubeCoversTheHullOfItsCornersExactly) {
  const geometry::Camera camera = testing_camera();
  Rng rng(5);
  for (int trial = 0; trial < 20; ++trial) {
    Scene scene = plain_scene();
    const Eigen::Matrix3d r = turned(rng.uniform(-3, 3), rng.uniform(-3, 3), rng.uniform(-3, 3));
    scene.items = {item_of(make_cube(), {rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), 3}, r)};
    const cv::Mat image = drawn(scene, camera);
    std::vector<cv::Point2f> corners;
    for (const cv::Vec3f& p : scene.items[0].mesh->positions) {
      const auto pixel = camera.project(scene.items[0].camera_from_mesh * geometry::to_eigen(p));
      ASSERT_TRUE(pixel);
      corners.emplace_back(*pixel);
    }
    std::vector<cv::Point2f> hull;
    cv::convexHull(corners, hull);
    int covered = 0;
    for (int y = 0; y < image.rows; ++y) {
      for (int x = 0; x < image.cols; ++x) {
        const double distance = cv::pointPolygonTest(
            hull, cv::Point2f(static_cast<float>(x), static_cast<float>(y)), true);
        if (std::abs(distance) < 0.02) continue;  // the grid of 1/256 px decides
        ASSERT_EQ(at(image, x, y) != kGround, distance > 0) << x << ' ' << y << ' ' << distance;
        covered += distance > 0 ? 1 : 0;
      }
    }
    EXPECT_GT(covered, 5000);
  }
}

TEST(Render, TrianglesThatShareAnEdgeThroughPixelCentresDoNotOverlap) {
  geometry::Camera camera = testing_camera(64, 64, 32);
  camera.cx = camera.cy = 32;
  const Mesh both = square(kRed);  // its corners and its diagonal lie on pixel centres
  Mesh upper = both;
  Mesh lower = both;
  upper.triangles.pop_back();
  lower.triangles.erase(lower.triangles.begin());
  lower.materials[0].color = kGreen;
  Scene scene = plain_scene();
  scene.items = {item_of(upper, {0, 0, 2}), item_of(lower, {0, 0, 2})};
  const cv::Mat one = drawn(scene, camera);
  std::swap(scene.items[0], scene.items[1]);
  EXPECT_EQ(cv::norm(one, drawn(scene, camera), cv::NORM_INF), 0);
  // Corners at 16 and 48: 32 x 32 pixels; the right and lower edge belong to the neighbour.
  cv::Mat covered;
  cv::inRange(one, cv::Scalar::all(100), cv::Scalar::all(100), covered);
  EXPECT_EQ(64 * 64 - cv::countNonZero(covered), 32 * 32);
  EXPECT_EQ(at(one, 16, 16) == kGround, false);
  EXPECT_EQ(at(one, 48, 48), kGround);
}

TEST(Render, TexturesStandUpright) {
  const geometry::Camera camera = testing_camera();
  cv::Mat pixels(2, 2, CV_8UC3);
  pixels.at<cv::Vec3b>(0, 0) = {255, 0, 0};  // top left blue
  pixels.at<cv::Vec3b>(0, 1) = {0, 255, 0};  // top right green
  pixels.at<cv::Vec3b>(1, 0) = {0, 0, 255};  // bottom left red
  pixels.at<cv::Vec3b>(1, 1) = {255, 255, 255};
  Mesh mesh = square({1, 1, 1});
  mesh.textures.push_back(make_texture(pixels));
  mesh.materials[0].texture = 0;
  Scene scene = plain_scene();
  scene.items = {item_of(mesh, {0, 0, 5})};  // covers 99.5 .. 219.5 by 59.5 .. 179.5
  const cv::Mat image = drawn(scene, camera);
  // Centres of the texels: a quarter of the size from each border.
  EXPECT_LT(cv::norm(cv::Vec3i(at(image, 129, 89)) - cv::Vec3i(255, 0, 0)), 8);
  EXPECT_LT(cv::norm(cv::Vec3i(at(image, 189, 89)) - cv::Vec3i(0, 255, 0)), 8);
  EXPECT_LT(cv::norm(cv::Vec3i(at(image, 129, 149)) - cv::Vec3i(0, 0, 255)), 8);
  EXPECT_LT(cv::norm(cv::Vec3i(at(image, 189, 149)) - cv::Vec3i(255, 255, 255)), 8);
  // In the middle between the upper two: half of each.
  EXPECT_LT(cv::norm(cv::Vec3i(at(image, 159, 89)) - cv::Vec3i(128, 128, 0)), 8);
}

TEST(Render, TexturesAreCorrectInPerspective) {
  const geometry::Camera camera = testing_camera();
  cv::Mat ramp(64, 256, CV_8UC3);
  for (int x = 0; x < 256; ++x) ramp.col(x).setTo(cv::Scalar::all(x));
  Mesh mesh = square({1, 1, 1});
  mesh.textures.push_back(make_texture(ramp));
  mesh.materials[0].texture = 0;
  Scene scene = plain_scene();
  const Eigen::Matrix3d r = turned(0, 1.0, 0);
  scene.items = {item_of(mesh, {0, 0, 3}, r)};
  const cv::Mat image = drawn(scene, camera);
  for (double x = -0.9; x < 0.9; x += 0.05) {
    for (double y : {-0.5, 0.0, 0.6}) {
      const auto pixel = camera.project(r * Eigen::Vector3d(x, y, 0) + Eigen::Vector3d(0, 0, 3));
      const int got = at(image, cvRound(pixel->x), cvRound(pixel->y))[0];
      EXPECT_NEAR(got, 256 * (x + 1) / 2 - 0.5, 3) << x << ' ' << y;
    }
  }
}

TEST(Render, AnOccluderHidesAndShowsTheImage) {
  const geometry::Camera camera = testing_camera();
  Scene scene = plain_scene();
  scene.items = {item_of(square(kRed), {0, 0, 5}), item_of(square(kGreen), {1, 0, 4})};
  scene.items[1].role = Role::kOccluder;  // covers x from 159.5 on
  const cv::Mat image = drawn(scene, camera);
  EXPECT_EQ(at(image, 130, 120), kRedPixel);
  EXPECT_EQ(at(image, 190, 120), kGround);
  scene.items[1].camera_from_mesh.translation[2] = 6;  // behind: hides nothing
  EXPECT_EQ(at(drawn(scene, camera), 190, 120), kRedPixel);
}

TEST(Render, LightFallsOffWithTheCosine) {
  const geometry::Camera camera = testing_camera();
  Scene scene;
  scene.light = {{0, 0, 1}, 0.25, 0.5, 0, 1};
  for (const Shading shading : {Shading::kGouraud, Shading::kPhong}) {
    scene.shading = shading;
    for (const double angle : {0.0, 0.4, 1.0}) {
      // The sides that face away are lit from the visible side: the same light.
      for (const double behind : {0.0, CV_PI}) {
        scene.items = {item_of(square(kGreen), {0, 0, 5}, turned(0, angle + behind, 0))};
        EXPECT_NEAR(at(drawn(scene, camera), 160, 120)[1], 255 * (0.25 + 0.5 * std::cos(angle)), 1)
            << angle;
      }
    }
  }
}

TEST(Render, PhongPutsTheHighlightWhereGouraudHasNoCorner) {
  const geometry::Camera camera = testing_camera();
  Scene scene;
  scene.light = {{0, 0, 1}, 0.2, 0.3, 1.0, 60};
  scene.items = {item_of(make_sphere(60, {0.2F, 0.2F, 0.2F}), {0, 0, 4})};
  scene.shading = Shading::kPhong;
  const cv::Mat image = drawn(scene, camera);
  EXPECT_EQ(at(image, 160, 120)[0], 255);  // reflects the light
  // Away from the reflection: almost only the diffuse part.
  EXPECT_LT(at(image, 160 + 50, 120)[0], 60);
  scene.shading = Shading::kGouraud;  // with many corners almost the same
  EXPECT_LT(cv::norm(image, drawn(scene, camera), cv::NORM_L1) / static_cast<double>(image.total()),
            3);
}

TEST(Render, BackFacesAreCulledOnRequest) {
  const geometry::Camera camera = testing_camera();
  Scene scene = plain_scene();
  scene.items = {item_of(square(kRed), {0, 0, 5}, turned(0, CV_PI, 0))};
  EXPECT_EQ(at(drawn(scene, camera), 160, 120), kRedPixel);
  scene.items[0].back_faces = false;
  EXPECT_EQ(at(drawn(scene, camera), 160, 120), kGround);
  scene.items[0].camera_from_mesh.rotation = Eigen::Matrix3d::Identity();
  EXPECT_EQ(at(drawn(scene, camera), 160, 120), kRedPixel);
}

TEST(Render, AFloorThatReachesBehindTheCameraIsClipped) {
  const geometry::Camera camera = testing_camera();
  Scene scene = plain_scene();
  scene.items = {item_of(square(kRed), {0, 1, 0}, turned(CV_PI / 2, 0, 0))};
  scene.items[0].scale = 1000;  // the plane y = 1 from z = -1000 to 1000
  const cv::Mat image = drawn(scene, camera);
  // Its end at z = 1000 projects to 0.3 px below the horizon at 119.5.
  for (int x = 0; x < 320; x += 20) {
    EXPECT_EQ(at(image, x, 119), kGround) << x;
    EXPECT_EQ(at(image, x, 120), kRedPixel) << x;
    EXPECT_EQ(at(image, x, 239), kRedPixel) << x;
  }
}

TEST(Render, AntialiasedEdgesAreBlendedByCoverage) {
  geometry::Camera camera = testing_camera(64, 64, 32);
  camera.cx = camera.cy = 32;
  Scene scene = plain_scene();
  scene.antialias = true;
  // The left border at 16 px: half of that pixel's samples (at 15.75 and 16.25).
  scene.items = {item_of(square({1, 1, 1}), {0, 0, 2})};
  const cv::Mat image = drawn(scene, camera);
  EXPECT_EQ(at(image, 15, 32)[0], 100);
  EXPECT_EQ(at(image, 16, 32)[0], (255 + 100 + 1) / 2);
  EXPECT_EQ(at(image, 17, 32)[0], 255);
  EXPECT_EQ(at(image, 16, 16)[0], (255 + 3 * 100 + 2) / 4);  // its corner: a quarter
}

TEST(Render, TheShadowIsProjectedFromTheLightAndDarkensOnce) {
  const geometry::Camera camera = testing_camera();
  // A cube of edge 1 on the plane z = 0, with z towards the viewer, seen from above.
  const geometry::Rigid3 camera_from_plane{Eigen::Matrix3d{{1, 0, 0}, {0, -1, 0}, {0, 0, -1}},
                                           {0, 0, 10}};
  const geometry::Rigid3 plane_from_cube{Eigen::Matrix3d::Identity(), {0, 0, 0.5}};
  const Eigen::Vector3d light(1, 0, -1);  // 45 degrees towards +x
  Scene scene = plain_scene();
  scene.darkness = 0.5;
  Item item = item_of(planar_shadow(make_cube(), plane_from_cube, 1, light), {0, 0, 0});
  item.role = Role::kShadow;
  item.camera_from_mesh = camera_from_plane;
  scene.items = {item};
  const cv::Mat image = drawn(scene, camera);
  // From x = -0.5 (bottom) to 0.5 + 1 (far edge of the top), 30 px per unit.
  const auto column = [&](double x) { return cvRound(camera.cx + 30 * x); };
  EXPECT_EQ(at(image, column(-0.6), 120), kGround);
  for (const double x : {-0.4, 0.0, 0.6, 1.4}) {  // under one, two and more triangles alike
    EXPECT_EQ(at(image, column(x), 120), cv::Vec3b(50, 50, 50)) << x;
  }
  EXPECT_EQ(at(image, column(1.6), 120), kGround);
  EXPECT_EQ(at(image, column(0), cvRound(camera.cy - 30 * 0.6)), kGround);
  // Objects below the plane cast no shadow.
  EXPECT_TRUE(planar_shadow(make_cube(), {Eigen::Matrix3d::Identity(), {0, 0, -2}}, 1, light)
                  .triangles.empty());
  EXPECT_THROW((void)planar_shadow(make_cube(), plane_from_cube, 1, {0, 0, 1}),
               std::invalid_argument);
}

TEST(Render, SolidsLieOverShadowsAndOccludersHideThem) {
  const geometry::Camera camera = testing_camera();
  Scene scene = plain_scene();
  scene.items = {item_of(square(kRed), {0, 0, 5}), item_of(square(kRed), {0.5, 0, 5})};
  scene.items[1].role = Role::kShadow;
  EXPECT_EQ(at(drawn(scene, camera), 200, 120), kRedPixel);
  EXPECT_EQ(at(drawn(scene, camera), 235, 120), cv::Vec3b(55, 55, 55));
  scene.items.push_back(item_of(square(kGreen), {1, 0, 4}));
  scene.items[2].role = Role::kOccluder;
  EXPECT_EQ(at(drawn(scene, camera), 235, 120), kGround);
}

TEST(Render, VerticesAreDistortedAsTheCameraDistorts) {
  geometry::Camera camera = testing_camera();
  camera.distortion = {-0.3, 0.1, 0.001, -0.002, 0};
  Mesh dot = square(kRed);
  for (cv::Vec3f& p : dot.positions) p *= 0.02F;
  Scene scene = plain_scene();
  for (const Eigen::Vector3d& at_point :
       {Eigen::Vector3d(1.2, 0.9, 3), Eigen::Vector3d(-1, -0.5, 3)}) {
    scene.items = {item_of(dot, at_point)};
    const cv::Mat image = drawn(scene, camera);
    cv::Mat mask;
    cv::inRange(image, cv::Scalar(0, 0, 255), cv::Scalar(0, 0, 255), mask);
    const cv::Moments moments = cv::moments(mask, true);
    ASSERT_GT(moments.m00, 4);
    EXPECT_NEAR(moments.m10 / moments.m00, camera.project(at_point)->x, 0.4);
    EXPECT_NEAR(moments.m01 / moments.m00, camera.project(at_point)->y, 0.4);
  }
  // Far outside the view, the polynomial would fold back into the image.
  scene.items = {item_of(dot, {30, 0, 3})};
  EXPECT_EQ(cv::norm(drawn(scene, camera), gray_background(camera), cv::NORM_INF), 0);
}

TEST(Render, IsTheSameForAnyNumberOfThreads) {
  const geometry::Camera camera = testing_camera(333, 217);
  Scene scene;
  scene.antialias = true;
  scene.shading = Shading::kPhong;
  scene.light.specular = 0.5;
  scene.items = {item_of(make_glasses(), {0, 0, 300}), item_of(make_hat(), {0, 40, 420}),
                 item_of(make_sphere(40, kGreen), {0, 0, 380})};
  scene.items[2].scale = 60;
  const int threads = cv::getNumThreads();
  cv::setNumThreads(1);
  const cv::Mat one = drawn(scene, camera);
  cv::setNumThreads(3);
  const cv::Mat three = drawn(scene, camera);
  cv::setNumThreads(threads);
  EXPECT_EQ(cv::norm(one, three, cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(one, gray_background(camera), cv::NORM_INF), 50);
}

TEST(Render, RefusesInvalidScenes) {
  const geometry::Camera camera = testing_camera();
  cv::Mat image = gray_background(camera);
  Scene scene = plain_scene();
  scene.items = {item_of(square(kRed), {0, 0, 5})};
  const auto refuses = [&](const Scene& bad) {
    EXPECT_THROW(render(image, bad, camera), std::invalid_argument);
  };
  Mesh mesh = square(kRed);
  mesh.triangles[1].position[2] = 4;
  Scene bad = scene;
  bad.items[0].mesh = std::make_shared<const Mesh>(mesh);
  refuses(bad);
  mesh = square(kRed);
  mesh.positions[0][1] = std::numeric_limits<float>::quiet_NaN();
  bad.items[0].mesh = std::make_shared<const Mesh>(mesh);
  refuses(bad);
  mesh = square(kRed);
  mesh.triangles[0].uv = {0, -1, 2};
  bad.items[0].mesh = std::make_shared<const Mesh>(mesh);
  refuses(bad);
  bad = scene;
  bad.items[0].mesh.reset();
  refuses(bad);
  bad = scene;
  bad.items[0].scale = 0;
  refuses(bad);
  bad = scene;
  bad.light.direction = {0, 0, 0};
  refuses(bad);
  bad = scene;
  bad.near = 0;
  refuses(bad);
  cv::Mat gray(10, 10, CV_8UC1);
  EXPECT_THROW(render(gray, scene, camera), std::invalid_argument);
}

TEST(Render, HandlesHugeCoordinates) {
  const geometry::Camera camera = testing_camera();
  Rng rng(9);
  Mesh mesh;
  const float sizes[] = {1e-30F, 1e-3F, 1.0F, 1e6F, 1e30F, 3e38F};
  for (int i = 0; i < 300; ++i) {
    const float size = sizes[rng.integer(0, 5)];
    mesh.positions.push_back({size * static_cast<float>(rng.uniform(-1, 1)),
                              size * static_cast<float>(rng.uniform(-1, 1)),
                              size * static_cast<float>(rng.uniform(-1, 1))});
    mesh.uvs.push_back({size, -size});
  }
  mesh.textures.push_back(make_texture(cv::Mat(3, 5, CV_8UC3, cv::Scalar(1, 2, 3))));
  Material material;
  material.texture = 0;
  mesh.materials = {material};
  for (int i = 0; i < 1000; ++i) {
    Triangle triangle;
    for (std::size_t k = 0; k < 3; ++k) triangle.position[k] = rng.integer(0, 299);
    triangle.uv = triangle.position;
    triangle.material = 0;
    mesh.triangles.push_back(triangle);
  }
  Scene scene;
  scene.items = {item_of(mesh, {0, 0, 2})};
  for (const bool antialias : {false, true}) {
    scene.antialias = antialias;
    EXPECT_NO_THROW((void)drawn(scene, camera));
  }
}

}  // namespace
}  // namespace tarsier::render
