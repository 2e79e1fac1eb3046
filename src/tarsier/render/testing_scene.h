// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/render/render.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <memory>

namespace tarsier::render {

inline geometry::Camera testing_camera(int width = 320, int height = 240, double focal = 300) {
  geometry::Camera camera;
  camera.width = width;
  camera.height = height;
  camera.fx = camera.fy = focal;
  camera.cx = (width - 1) / 2.0;
  camera.cy = (height - 1) / 2.0;
  return camera;
}

inline cv::Mat gray_background(const geometry::Camera& camera, int value = 100) {
  return {camera.height, camera.width, CV_8UC3, cv::Scalar::all(value)};
}

// A square of edge 2 in the plane z = 0, facing -z, with its texture upright for y down.
inline Mesh square(const cv::Vec3f& color) {
  Mesh mesh;
  mesh.positions = {{-1, 1, 0}, {1, 1, 0}, {1, -1, 0}, {-1, -1, 0}};
  mesh.uvs = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  Material material;
  material.color = color;
  mesh.materials = {material};
  Triangle triangle;
  triangle.material = 0;
  triangle.position = {0, 1, 2};
  triangle.uv = {0, 1, 2};
  mesh.triangles.push_back(triangle);
  triangle.position = {0, 2, 3};
  triangle.uv = {0, 2, 3};
  mesh.triangles.push_back(triangle);
  return mesh;
}

inline Item item_of(const Mesh& mesh, const Eigen::Vector3d& at,
                    const Eigen::Matrix3d& rotation = Eigen::Matrix3d::Identity()) {
  Item item;
  item.mesh = std::make_shared<const Mesh>(mesh);
  item.camera_from_mesh = {rotation, at};
  return item;
}

// A scene without shading: every surface has its own colour.
inline Scene plain_scene() {
  Scene scene;
  scene.light.ambient = 1;
  scene.light.diffuse = 0;
  return scene;
}

}  // namespace tarsier::render
