// SPDX-License-Identifier: MIT
#include "tarsier/render/builtin.h"

#include "tarsier/geometry/opencv_types.h"
#include "tarsier/render/testing_scene.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

namespace tarsier::render {
namespace {

// Sum over triangles of the signed volume to the origin; positive if the surfaces face outwards.
double volume(const Mesh& mesh) {
  double sum = 0;
  for (const Triangle& t : mesh.triangles) {
    const auto p = [&](std::size_t k) {
      return geometry::to_eigen(mesh.positions[static_cast<std::size_t>(t.position[k])]);
    };
    sum += p(0).dot(p(1).cross(p(2))) / 6;
  }
  return sum;
}

TEST(Builtin, MeshesAreValidWithOutwardNormals) {
  for (const std::string& name : builtin_names()) {
    const auto mesh = builtin_mesh(name);
    ASSERT_TRUE(mesh) << name;
    mesh->check();
    EXPECT_GT(mesh->triangles.size(), 10U) << name;
    EXPECT_GT(volume(*mesh), 0) << name;
    for (const Triangle& t : mesh->triangles) {
      EXPECT_GE(t.normal[0], 0) << name;
      // Every normal points to the side from which the triangle's corners are counter-clockwise.
      const auto p = [&](std::size_t k) {
        return mesh->positions[static_cast<std::size_t>(t.position[k])];
      };
      const cv::Vec3f face = (p(1) - p(0)).cross(p(2) - p(0));
      for (const int n : t.normal) {
        EXPECT_GT(face.dot(mesh->normals[static_cast<std::size_t>(n)]), 0) << name;
      }
    }
  }
  EXPECT_FALSE(builtin_mesh("teapot"));
}

TEST(Builtin, SizesAreAsDocumented) {
  EXPECT_NEAR(volume(make_cube()), 1, 1e-6);
  EXPECT_NEAR(volume(make_sphere(80, {1, 1, 1})), 4.0 / 3 * CV_PI, 0.01);
  EXPECT_EQ(make_sphere(51, {1, 1, 1}).triangles.size(), 4U * 51 * 50);
  const Bounds axes = bounds_of(make_axes());
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(axes.high[k], 1, 1e-6);
  // Glasses lie in front of a head's eyes and reach back to its ears.
  const Bounds glasses = bounds_of(make_glasses());
  EXPECT_LT(glasses.low[2], -20);
  EXPECT_GT(glasses.high[2], 60);
  EXPECT_NEAR(glasses.low[0], -glasses.high[0], 0.5);
}

TEST(Builtin, AllSixFacesOfTheCubeShowTheTextureUpright) {
  cv::Mat pixels(64, 64, CV_8UC3, cv::Scalar(0, 0, 255));       // red,
  pixels(cv::Rect(0, 0, 32, 32)).setTo(cv::Scalar(255, 0, 0));  // its top left quarter blue
  const Mesh cube = make_cube(make_texture(pixels));
  const geometry::Camera camera = testing_camera();
  // Frontal view along the head's y axis, with z up: camera x = x, camera y = -z, camera z = y.
  const Eigen::Matrix3d front{{1, 0, 0}, {0, 0, -1}, {0, 1, 0}};
  for (int quarter = 0; quarter < 4; ++quarter) {
    const double a = quarter * CV_PI / 2;
    const Eigen::Matrix3d turn{
        {std::cos(a), -std::sin(a), 0}, {std::sin(a), std::cos(a), 0}, {0, 0, 1}};
    cv::Mat image = gray_background(camera);
    Scene scene = plain_scene();
    scene.items = {item_of(cube, {0, 0, 3}, front * turn)};
    scene.items[0].back_faces = false;
    render(image, scene, camera);
    EXPECT_EQ(image.at<cv::Vec3b>(95, 135), cv::Vec3b(255, 0, 0)) << quarter;
    EXPECT_EQ(image.at<cv::Vec3b>(95, 185), cv::Vec3b(0, 0, 255)) << quarter;
    EXPECT_EQ(image.at<cv::Vec3b>(145, 135), cv::Vec3b(0, 0, 255)) << quarter;
  }
}

}  // namespace
}  // namespace tarsier::render
