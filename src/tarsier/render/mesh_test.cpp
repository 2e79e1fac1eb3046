// SPDX-License-Identifier: MIT
#include "tarsier/render/mesh.h"

#include "tarsier/render/testing_scene.h"

#include <gtest/gtest.h>

#include <cmath>

namespace tarsier::render {
namespace {

// Two squares that meet with the angle `angle` between their normals.
Mesh folded(double angle) {
  Mesh mesh;
  const float c = static_cast<float>(std::cos(angle));
  const float s = static_cast<float>(std::sin(angle));
  mesh.positions = {{0, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {-1, 1, 0}, {c, 0, -s}, {c, 1, -s}};
  for (const std::array<int, 3>& p :
       {std::array<int, 3>{2, 0, 1}, {2, 1, 3}, {0, 4, 5}, {0, 5, 1}}) {
    Triangle triangle;
    triangle.position = p;
    mesh.triangles.push_back(triangle);
  }
  return mesh;
}

TEST(Mesh, NormalsAreSmoothExceptAtCreases) {
  Mesh shallow = folded(0.5);
  add_normals(shallow, 50);
  Mesh sharp = folded(1.2);
  add_normals(sharp, 50);
  const auto normal = [](const Mesh& mesh, std::size_t triangle, std::size_t corner) {
    return mesh.normals[static_cast<std::size_t>(mesh.triangles[triangle].normal[corner])];
  };
  // The corner at the origin, from both sides of the fold.
  EXPECT_NEAR(normal(sharp, 0, 1)[2], 1, 1e-6);
  EXPECT_LT(normal(sharp, 2, 0)[2], 0.5);
  EXPECT_LT(normal(shallow, 0, 1)[2], 0.999);
  EXPECT_GT(normal(shallow, 0, 1)[0], 0.05);  // tilted towards the other square
  for (const cv::Vec3f& n : shallow.normals) EXPECT_NEAR(cv::norm(n), 1, 1e-6);
}

TEST(Mesh, GivenNormalsAreKept) {
  Mesh mesh = square({1, 1, 1});
  mesh.normals.push_back(cv::Vec3f(1, 0, 0));
  mesh.triangles[0].normal = {0, 0, 0};
  add_normals(mesh);
  EXPECT_EQ(mesh.triangles[0].normal[1], 0);
  EXPECT_GT(mesh.triangles[1].normal[1], 0);
  mesh.check();
}

TEST(Mesh, AppendingKeepsBothMeshes) {
  Mesh mesh = square({1, 0, 0});
  Mesh other = square({0, 1, 0});
  other.textures.push_back(make_texture(cv::Mat(2, 2, CV_8UC3, cv::Scalar::all(9))));
  other.materials[0].texture = 0;
  for (cv::Vec3f& p : other.positions) p[2] += 7;
  append(mesh, other);
  mesh.check();
  ASSERT_EQ(mesh.triangles.size(), 4U);
  const Triangle& last = mesh.triangles.back();
  EXPECT_EQ(mesh.positions[static_cast<std::size_t>(last.position[0])][2], 7);
  EXPECT_EQ(mesh.materials[static_cast<std::size_t>(last.material)].texture, 0);
  EXPECT_EQ(bounds_of(mesh).high[2], 7);
  EXPECT_EQ(bounds_of(mesh).low[0], -1);
}

TEST(Mesh, MipmapsEndAtOneTexel) {
  const Texture texture = make_texture(cv::Mat(3, 10, CV_8UC3, cv::Scalar(10, 20, 30)));
  ASSERT_EQ(texture.levels.size(), 4U);  // 10 x 3, 5 x 1, 2 x 1, 1 x 1
  EXPECT_EQ(texture.levels.back().size(), cv::Size(1, 1));
  EXPECT_EQ(texture.levels.back().at<cv::Vec3b>(0, 0), cv::Vec3b(10, 20, 30));
  EXPECT_THROW((void)make_texture(cv::Mat()), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::render
