// SPDX-License-Identifier: MIT
#include "tarsier/core/angles.h"
#include "tarsier/core/rng.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/sfm/global/positioning.h"
#include "tarsier/sfm/global/rotation_averaging.h"
#include "tarsier/sfm/global/view_graph.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace tarsier::sfm {
namespace {

Eigen::Vector3d any_direction(Rng& rng) {
  Eigen::Vector3d v;
  do {
    v = {rng.uniform(-1, 1), rng.uniform(-1, 1), rng.uniform(-1, 1)};
  } while (v.norm() > 1 || v.norm() < 0.1);
  return v.normalized();
}

std::vector<Eigen::Matrix3d> any_rotations(int count, Rng& rng) {
  std::vector<Eigen::Matrix3d> rotations;
  for (int i = 0; i < count; ++i)
    rotations.push_back(geometry::rotation_by(rng.uniform(0, 3) * any_direction(rng)));
  return rotations;
}

// Edges of each node to the next ones in a ring, with noise and a share of random outliers.
std::vector<RelativeRotation> ring_of(const std::vector<Eigen::Matrix3d>& rotations, int next,
                                      double noise_deg, double outlier_share, Rng& rng) {
  std::vector<RelativeRotation> edges;
  const int count = static_cast<int>(rotations.size());
  for (int i = 0; i < count; ++i) {
    for (int k = 1; k <= next; ++k) {
      const int j = (i + k) % count;
      RelativeRotation edge{i, j, Eigen::Matrix3d::Identity(), rng.uniform(30, 300)};
      const double max_angle =
          rng.uniform() < outlier_share ? 120 * kRadiansPerDegree : noise_deg * kRadiansPerDegree;
      edge.second_from_first =
          geometry::rotation_by(max_angle * rng.uniform() * any_direction(rng)) *
          rotations[static_cast<std::size_t>(j)] *
          rotations[static_cast<std::size_t>(i)].transpose();
      edges.push_back(edge);
    }
  }
  return edges;
}

// Largest angle to the truth after the first rotations are aligned, degrees.
double worst_rotation(const std::vector<Eigen::Matrix3d>& found,
                      const std::vector<Eigen::Matrix3d>& truth) {
  double worst = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const Eigen::Matrix3d error =
        found[i] * found[0].transpose() * (truth[i] * truth[0].transpose()).transpose();
    worst = std::max(worst, geometry::angle_of(error) / kRadiansPerDegree);
  }
  return worst;
}

TEST(RotationAveraging, IsExactWithoutNoise) {
  Rng rng(1);
  const auto truth = any_rotations(40, rng);
  const auto averaged = average_rotations(40, ring_of(truth, 4, 0, 0, rng));
  EXPECT_LT(worst_rotation(averaged.rotations, truth), 1e-5);
  EXPECT_EQ(averaged.rotations[0], Eigen::Matrix3d(Eigen::Matrix3d::Identity()));
}

TEST(RotationAveraging, ToleratesOutlierEdges) {
  Rng rng(2);
  const auto truth = any_rotations(60, rng);
  const auto edges = ring_of(truth, 6, 0.5, 0.2, rng);
  const auto averaged = average_rotations(60, edges);
  EXPECT_LT(worst_rotation(averaged.rotations, truth), 1.0);
  EXPECT_GT(std::count_if(averaged.errors_deg.begin(), averaged.errors_deg.end(),
                          [](double error) { return error > 10; }),
            36);  // of about 65 that are off by up to 120 degrees
}

TEST(RotationAveraging, RefusesUnconnectedGraph) {
  const std::vector<RelativeRotation> edges{{0, 1}, {2, 3}};
  EXPECT_THROW((void)average_rotations(4, edges), std::invalid_argument);
}

TEST(ViewGraph, CyclesIdentifyWrongEdge) {
  Rng rng(3);
  const auto truth = any_rotations(5, rng);
  std::vector<RelativeRotation> edges;
  for (int i = 0; i < 5; ++i)
    for (int j = i + 1; j < 5; ++j)
      edges.push_back(
          {i, j,
           truth[static_cast<std::size_t>(j)] * truth[static_cast<std::size_t>(i)].transpose()});
  edges[2].second_from_first = geometry::rotation_by({0, 1, 0}) * edges[2].second_from_first;
  const auto support = check_cycles(5, edges, 2);
  for (std::size_t e = 0; e < edges.size(); ++e) {
    EXPECT_EQ(support[e].cycles, 3);
    EXPECT_EQ(support[e].closed > 0, e != 2) << e;
  }
}

TEST(ViewGraph, FindsLargestComponent) {
  EXPECT_EQ(largest_component(7, {{5, 1}, {1, 3}, {2, 4}}), (std::vector<int>{1, 3, 5}));
  EXPECT_EQ(largest_component(3, {}), (std::vector<int>{0}));
}

TEST(ViewGraph, RadiusOfChainRingAndStar) {
  std::vector<RelativeRotation> chain;
  for (int i = 0; i < 20; ++i) chain.push_back({i + 1, i});
  EXPECT_EQ(radius(21, chain), 10);
  std::vector<RelativeRotation> ring = chain;
  ring.push_back({20, 0});
  EXPECT_EQ(radius(21, ring), 10);
  std::vector<RelativeRotation> star;
  for (int i = 1; i < 9; ++i) star.push_back({0, i});
  EXPECT_EQ(radius(9, star), 1);
  EXPECT_EQ(radius(1, {}), 0);
}

struct Scene {
  std::vector<Eigen::Vector3d> cameras;
  PositioningProblem problem;
};

// Cameras on a circle that look outwards or inwards. Some of them observe each point.
Scene circle(int cameras, int points, double noise_deg, double outlier_share, Rng& rng) {
  Scene scene;
  for (int i = 0; i < cameras; ++i) {
    const double angle = 2 * std::numbers::pi * i / cameras;
    scene.cameras.emplace_back(10 * std::cos(angle), 10 * std::sin(angle), rng.uniform(-0.5, 0.5));
  }
  scene.problem.cameras = cameras;
  for (int p = 0; p < points; ++p) {
    const double angle = rng.uniform(0, 2 * std::numbers::pi);
    const double radius = rng.uniform(12, 25);
    const Eigen::Vector3d point(radius * std::cos(angle), radius * std::sin(angle),
                                rng.uniform(-4, 4));
    std::vector<PositioningProblem::Ray> rays;
    for (int i = 0; i < cameras; ++i) {
      const Eigen::Vector3d& center = scene.cameras[static_cast<std::size_t>(i)];
      if (center.dot(point) < 0.9 * center.norm() * point.norm()) continue;
      Eigen::Vector3d direction = (point - center).normalized();
      direction = rng.uniform() < outlier_share
                      ? any_direction(rng)
                      : Eigen::Vector3d(geometry::rotation_by(noise_deg * kRadiansPerDegree *
                                                              rng.uniform() * any_direction(rng)) *
                                        direction);
      rays.push_back({i, direction});
    }
    if (rays.size() < 2) continue;
    scene.problem.first.push_back(scene.problem.rays.size());
    scene.problem.rays.insert(scene.problem.rays.end(), rays.begin(), rays.end());
  }
  scene.problem.first.push_back(scene.problem.rays.size());
  return scene;
}

// Root mean square distance to the truth after the best translation and scale, in radii of the
// circle.
double position_error(const std::vector<Eigen::Vector3d>& found,
                      const std::vector<Eigen::Vector3d>& truth) {
  Eigen::Vector3d a = Eigen::Vector3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  const auto count = static_cast<double>(truth.size());
  for (std::size_t i = 0; i < truth.size(); ++i) {
    a += found[i] / count;
    b += truth[i] / count;
  }
  double dot = 0;
  double square = 0;
  for (std::size_t i = 0; i < truth.size(); ++i) {
    dot += (found[i] - a).dot(truth[i] - b);
    square += (found[i] - a).squaredNorm();
  }
  double sum = 0;
  for (std::size_t i = 0; i < truth.size(); ++i)
    sum += (dot / square * (found[i] - a) - (truth[i] - b)).squaredNorm();
  return std::sqrt(sum / count) / 10;
}

TEST(Positioning, IsExactWithoutNoise) {
  Rng rng(4);
  const Scene scene = circle(30, 400, 0, 0, rng);
  const auto found = position_cameras(scene.problem);
  ASSERT_TRUE(found.has_value());
  EXPECT_LT(position_error(found->cameras, scene.cameras), 1e-3);
  EXPECT_LT(*std::max_element(found->errors.begin(), found->errors.end()), 1e-3);
}

TEST(Positioning, ToleratesOutlierRays) {
  Rng rng(5);
  const Scene scene = circle(40, 800, 0.2, 0.1, rng);
  const auto found = position_cameras(scene.problem);
  ASSERT_TRUE(found.has_value());
  EXPECT_LT(position_error(found->cameras, scene.cameras), 0.02);
}

// Streets around three by three blocks. Points lie on both sides of the streets, and are seen by
// the cameras of the last 20 m, which look along the street. The rotations of the cameras are
// inexact.
Scene streets(double rotation_noise_deg, Rng& rng) {
  constexpr int kBlocks = 3;
  constexpr int kBlock = 40;     // m
  constexpr double kReach = 20;  // m
  Scene scene;
  std::vector<Eigen::Vector3d> directions;  // of the cameras
  std::vector<Eigen::Vector3d> points;
  const auto near = [&](double along, double across, int street, bool is_turned, double z) {
    across += street * kBlock;
    return is_turned ? Eigen::Vector3d(across, along, z) : Eigen::Vector3d(along, across, z);
  };
  for (int street = 0; street <= kBlocks; ++street) {
    for (const bool is_turned : {false, true}) {
      for (int i = 0; i < kBlocks * kBlock; ++i) {
        scene.cameras.push_back(near(i, rng.uniform(-0.3, 0.3), street, is_turned, 0));
        directions.push_back(is_turned ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitX());
        for (int k = 0; k < 6; ++k)
          points.push_back(
              near(i + rng.uniform(), k % 2 == 0 ? 3 : -3, street, is_turned, rng.uniform(-2, 4)));
      }
    }
  }
  std::vector<Eigen::Matrix3d> errors;
  for (std::size_t i = 0; i < scene.cameras.size(); ++i)
    errors.push_back(geometry::rotation_by(rotation_noise_deg * kRadiansPerDegree * rng.uniform() *
                                           any_direction(rng)));
  scene.problem.cameras = static_cast<int>(scene.cameras.size());
  for (const Eigen::Vector3d& point : points) {
    scene.problem.first.push_back(scene.problem.rays.size());
    for (std::size_t i = 0; i < scene.cameras.size(); ++i) {
      const Eigen::Vector3d to = point - scene.cameras[i];
      if (to.norm() < kReach && to.dot(directions[i]) > 0.8 * to.norm())
        scene.problem.rays.push_back({static_cast<int>(i), errors[i] * to.normalized()});
    }
    if (scene.problem.rays.size() >= scene.problem.first.back() + 2) continue;
    scene.problem.rays.resize(scene.problem.first.back());
    scene.problem.first.pop_back();
  }
  scene.problem.first.push_back(scene.problem.rays.size());
  return scene;
}

// Damping of the positions themselves leaves errors of 7 m after 49 steps.
TEST(Positioning, LongStreetsBendInFewSteps) {
  Rng rng(6);
  const Scene scene = streets(0.2, rng);
  const auto found = position_cameras(scene.problem);
  ASSERT_TRUE(found.has_value());
  EXPECT_LT(10 * position_error(found->cameras, scene.cameras), 0.1);
  EXPECT_LT(found->iterations, 30);
}

TEST(Positioning, RefusesPointWithOneRay) {
  PositioningProblem problem;
  problem.cameras = 2;
  problem.first = {0, 1};
  problem.rays = {{0, Eigen::Vector3d::UnitZ()}};
  EXPECT_THROW((void)position_cameras(problem), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::sfm
