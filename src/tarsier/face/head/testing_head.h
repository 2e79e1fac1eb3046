// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/angles.h"
#include "tarsier/core/rng.h"
#include "tarsier/face/head/angles.h"
#include "tarsier/face/head/head_model.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/linalg/decompositions.h"

#include <Eigen/Core>

#include <cmath>
#include <numeric>

// A synthetic head with exact ground truth, for tests: 25 points on an ellipsoid with a nose.
namespace tarsier::face::head {

inline geometry::Camera testing_camera() {
  geometry::Camera camera;
  camera.width = 640;
  camera.height = 480;
  camera.fx = camera.fy = 800;
  camera.cx = 320;
  camera.cy = 240;
  return camera;
}

// 11 pairs and 3 points in the plane of symmetry (nose tip, mouth, chin: 22, 23, 24). Points 0 and
// 1 are the outer eye corners, 89 mm apart.
inline HeadModel testing_head(int modes, std::uint64_t seed = 3) {
  HeadModel model;
  const double rows[11][2] = {{44.5, 0}, {20, 2},  {60, -15}, {35, -24}, {12, -18}, {14, 40},
                              {26, 64},  {12, 74}, {70, 20},  {62, 60},  {35, 98}};
  model.mean.resize(3, 25);
  const auto depth = [](double x, double y) {
    return 0.009 * x * x + 0.0015 * (y - 30) * (y - 30) - 0.009 * 44.5 * 44.5 - 0.0015 * 900;
  };
  for (int k = 0; k < 11; ++k) {
    const double z = depth(rows[k][0], rows[k][1]);
    model.mean.col(2 * k) << -rows[k][0], rows[k][1], z;
    model.mean.col(2 * k + 1) << rows[k][0], rows[k][1], z;
    model.mirror.push_back(2 * k + 1);
    model.mirror.push_back(2 * k);
  }
  model.mean.col(22) << 0, 36, depth(0, 36) - 22;
  model.mean.col(23) << 0, 66, depth(0, 66) - 4;
  model.mean.col(24) << 0, 112, depth(0, 112);
  for (int k = 22; k < 25; ++k) model.mirror.push_back(k);
  model.outer_eyes = {0, 1};
  model.landmark.resize(25);
  std::iota(model.landmark.begin(), model.landmark.end(), 100);
  model.connections = {{0, 1}, {22, 23}};
  model.noise = Eigen::VectorXd::Constant(25, 0.5);
  model.trained_on = 10;
  // Symmetric modes that neither move, rotate nor scale the head.
  Rng rng(seed);
  Eigen::MatrixXd all = Eigen::MatrixXd::Zero(75, 4 + modes);
  const Eigen::Matrix3Xd centred = model.mean.colwise() - model.mean.rowwise().mean();
  for (int i = 0; i < 25; ++i) {
    all(3 * i + 1, 0) = 1;
    all(3 * i + 2, 1) = 1;
    all.block<3, 1>(3 * i, 2) = centred.col(i);
    all(3 * i + 1, 3) = -centred(2, i);
    all(3 * i + 2, 3) = centred(1, i);
    const int other = model.mirror[static_cast<std::size_t>(i)];
    for (int k = 4; k < 4 + modes; ++k) {
      if (other < i) continue;
      const Eigen::Vector3d value(other == i ? 0 : rng.normal(), rng.normal(), rng.normal());
      all.block<3, 1>(3 * i, k) = value;
      if (other > i) all.block<3, 1>(3 * other, k) = Eigen::Vector3d(-1, 1, 1).cwiseProduct(value);
    }
  }
  const Eigen::MatrixXd q = linalg::orthonormal_basis(all);
  model.modes = q.rightCols(modes);
  model.deviation.resize(modes);
  for (int k = 0; k < modes; ++k) model.deviation[k] = 14.0 / (1 + k);
  model.check();
  return model;
}

inline geometry::Rigid3 random_pose(Rng& rng) {
  geometry::Rigid3 pose;
  const double yaw = rng.uniform(-45, 45);
  const double pitch = rng.uniform(-30, 30);
  pose.rotation = rotation_of_angles({yaw, pitch, rng.uniform(-20, 20)});
  const double distance = rng.uniform(450, 900);
  const double x = distance * rng.uniform(-0.2, 0.2);
  pose.translation = {x, distance * rng.uniform(-0.1, 0.1), distance};
  return pose;
}

inline double degrees_between(const geometry::Rigid3& a, const geometry::Rigid3& b) {
  return geometry::angle_of(a.rotation * b.rotation.transpose()) * kDegreesPerRadian;
}

// 2 x n px, with Gaussian noise.
inline Eigen::Matrix2Xd image_of(const Eigen::Matrix3Xd& shape, const geometry::Rigid3& pose,
                                 const geometry::Camera& camera, double noise_px, Rng& rng) {
  Eigen::Matrix2Xd pixels(2, shape.cols());
  for (Eigen::Index i = 0; i < shape.cols(); ++i) {
    const auto pixel = camera.project(pose * shape.col(i));
    const double x = noise_px * rng.normal();
    pixels.col(i) << pixel.value().x + x, pixel.value().y + noise_px * rng.normal();
  }
  return pixels;
}

}  // namespace tarsier::face::head
