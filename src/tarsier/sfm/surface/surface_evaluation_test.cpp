// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/surface_evaluation.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/media/testing_folder.h"
#include "tarsier/sfm/surface/testing_surface.h"
#include "tarsier/sfm/surface/triangle_tree.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <numbers>
#include <stdexcept>

namespace tarsier::sfm {
namespace {

// A sphere around the origin made of rings of triangles, from `from` to `to` (0..1 from pole to
// pole).
SurfaceMesh sphere(float radius, float from = 0, float to = 1) {
  constexpr int kRings = 60;
  constexpr int kSegments = 120;
  SurfaceMesh mesh;
  for (int i = 0; i <= kRings; ++i) {
    const float polar = std::numbers::pi_v<float> *
                        (from + (to - from) * static_cast<float>(i) / static_cast<float>(kRings));
    for (int j = 0; j < kSegments; ++j) {
      const float angle = 2 * std::numbers::pi_v<float> * static_cast<float>(j) / kSegments;
      mesh.vertices.emplace_back(radius * std::sin(polar) * std::cos(angle),
                                 radius * std::sin(polar) * std::sin(angle),
                                 radius * std::cos(polar));
    }
  }
  for (int i = 0; i < kRings; ++i) {
    for (int j = 0; j < kSegments; ++j) {
      const int a = i * kSegments + j;
      const int b = i * kSegments + (j + 1) % kSegments;
      mesh.faces.push_back({a, a + kSegments, b});
      mesh.faces.push_back({b, a + kSegments, b + kSegments});
    }
  }
  return mesh;
}

TEST(TriangleDistance, ToInsideSidesAndCorners) {
  const Eigen::Vector3f a(0, 0, 0);
  const Eigen::Vector3f b(4, 0, 0);
  const Eigen::Vector3f c(0, 4, 0);
  EXPECT_FLOAT_EQ(triangle_distance({1, 1, -2}, a, b, c), 2);
  EXPECT_FLOAT_EQ(triangle_distance({1, -3, 4}, a, b, c), 5);
  EXPECT_FLOAT_EQ(triangle_distance({-2, -3, 6}, a, b, c), 7);
  EXPECT_FLOAT_EQ(triangle_distance({3, 3, 0}, a, b, c), std::sqrt(2.F));
  EXPECT_FLOAT_EQ(triangle_distance({5, 1, 0}, a, b, b), std::sqrt(2.F));  // a line
  EXPECT_FLOAT_EQ(triangle_distance({3, 4, 0}, a, a, a), 5);               // a point
}

TEST(TriangleTree, AgreesWithExhaustiveSearch) {
  Rng rng(5);
  SurfaceMesh mesh;
  const auto any = [&](float size) {
    const auto x = static_cast<float>(rng.uniform(-1, 1));
    const auto y = static_cast<float>(rng.uniform(-1, 1));
    const auto z = static_cast<float>(rng.uniform(-1, 1));
    return Eigen::Vector3f(size * x, size * y, size * z);
  };
  for (int f = 0; f < 500; ++f) {
    const Eigen::Vector3f center = any(3);
    for (int k = 0; k < 3; ++k) mesh.vertices.emplace_back(center + any(f % 50 == 0 ? 3.F : 0.2F));
    mesh.faces.push_back({3 * f, 3 * f + 1, 3 * f + 2});
  }
  const TriangleTree tree(mesh);
  for (int i = 0; i < 300; ++i) {
    const Eigen::Vector3f from = any(5);
    float nearest = 2;
    for (const Face& face : mesh.faces) {
      const auto corner = [&](std::size_t k) {
        return mesh.vertices[static_cast<std::size_t>(face[k])];
      };
      nearest = std::min(nearest, triangle_distance(from, corner(0), corner(1), corner(2)));
    }
    EXPECT_FLOAT_EQ(tree.distance(from, 2), nearest);
  }
  EXPECT_EQ(TriangleTree({}).distance({0, 0, 0}, 2), 2);
}

TEST(TriangleTree, RefusesABrokenSurface) {
  SurfaceMesh mesh = sphere(1);
  mesh.faces[3][1] = -1;
  EXPECT_THROW(TriangleTree{mesh}, std::invalid_argument);
}

TEST(SampleSurface, EvenlyOverTheArea) {
  SurfaceMesh mesh;  // two rectangles with areas 4 and 1, each of two triangles
  mesh.vertices = {{0, 0, 0}, {4, 0, 0}, {4, 1, 0}, {0, 1, 0},
                   {0, 0, 5}, {1, 0, 5}, {1, 1, 5}, {0, 1, 5}};
  mesh.faces = {{0, 1, 2}, {0, 2, 3}, {4, 5, 6}, {4, 6, 7}};
  const std::vector<cv::Vec3f> points = sample_surface(mesh, 0.01);
  EXPECT_NEAR(static_cast<double>(points.size()), 50'000, 2);
  int upper = 0;
  int right = 0;
  for (const cv::Vec3f& point : points) {
    upper += point[2] > 1 ? 1 : 0;
    right += point[2] < 1 && point[0] > 2 ? 1 : 0;
  }
  EXPECT_NEAR(upper, 10'000, 2);
  EXPECT_NEAR(right, 20'000, 200);
  EXPECT_EQ(points, sample_surface(mesh, 0.01));
  EXPECT_THROW((void)sample_surface(mesh, 0), std::invalid_argument);
}

class SurfaceEvaluationTest : public FolderTest {
 protected:
  // Twelve cameras around a sphere of radius 1.
  [[nodiscard]] Workspace cameras() const {
    write_workspace(path("truth"), sphere_caster({0, 0, 0}, 1), test_camera(),
                    cameras_all_around(12, 4));
    return Workspace::open(path("truth"));
  }
  [[nodiscard]] static SurfaceScores scores_of(const Workspace& cameras, const SurfaceMesh& surface,
                                               const geometry::Sim3& truth_from_model = {}) {
    NoProgress progress;
    return evaluate_surface(cameras, sphere(1), surface, truth_from_model, progress, {});
  }
};

TEST_F(SurfaceEvaluationTest, TheGroundTruthIsExactAndComplete) {
  const SurfaceScores scores = scores_of(cameras(), sphere(1));
  EXPECT_NEAR(scores.extent, std::sqrt(12.0), 0.1);
  EXPECT_LT(scores.distance_median, 1e-5);
  ASSERT_EQ(scores.thresholds.size(), 3U);
  EXPECT_GT(scores.thresholds[0].accuracy, 0.9999);
  EXPECT_GT(scores.thresholds[0].completeness, 0.9999);
}

TEST_F(SurfaceEvaluationTest, ALargerSphereFailsOnlyTheSmallThresholds) {
  // Too large by 0.7 % of the extent.
  const SurfaceScores scores = scores_of(cameras(), sphere(1.0242F));
  EXPECT_NEAR(scores.distance_median, 0.0242, 0.001);
  EXPECT_EQ(scores.thresholds[1].f1, 0);
  EXPECT_GT(scores.thresholds[2].f1, 0.999);
  // Its errors are drawn in another colour than no error.
  ASSERT_EQ(scores.errors.colors.size(), scores.errors.vertices.size());
  EXPECT_NE(scores.errors.colors[1000], scores_of(cameras(), sphere(1)).errors.colors[1000]);
}

TEST_F(SurfaceEvaluationTest, HalfASphereIsExactAndHalfComplete) {
  const SurfaceScores scores = scores_of(cameras(), sphere(1, 0, 0.5F));
  EXPECT_GT(scores.thresholds[0].accuracy, 0.9999);
  EXPECT_NEAR(scores.thresholds[0].completeness, 0.5, 0.02);
  EXPECT_NEAR(scores.thresholds[0].f1, 2.0 / 3, 0.02);
}

TEST_F(SurfaceEvaluationTest, TheSurfaceIsAlignedToTheGroundTruth) {
  SurfaceMesh moved = sphere(1);
  for (Eigen::Vector3f& vertex : moved.vertices) vertex = 2 * vertex + Eigen::Vector3f(3, 0, 0);
  geometry::Sim3 back;
  back.scale = 0.5;
  back.translation = Eigen::Vector3d(-1.5, 0, 0);
  const Workspace truth = cameras();
  EXPECT_LT(scores_of(truth, moved, back).distance_median, 1e-5);
  EXPECT_LT(scores_of(truth, moved).thresholds[2].completeness, 0.05);
}

TEST_F(SurfaceEvaluationTest, RefusesAnEmptySurface) {
  const Workspace truth = cameras();
  EXPECT_THROW((void)scores_of(truth, {}), std::invalid_argument);
  SurfaceMesh flat = sphere(1);
  for (Eigen::Vector3f& vertex : flat.vertices) vertex.setZero();
  EXPECT_THROW((void)scores_of(truth, flat), std::invalid_argument);
  flat.vertices[0][0] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW((void)scores_of(truth, flat), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::sfm
