// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/refinement.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/rng.h"
#include "tarsier/sfm/surface/decimation.h"

#include <gtest/gtest.h>
#include <opencv2/core/utility.hpp>

#include <cmath>
#include <numbers>

namespace tarsier::sfm {
namespace {

// A unit sphere made of rings; the last `open` rings around the south pole are missing.
SurfaceMesh globe(int rings, int around, int open = 0) {
  SurfaceMesh mesh;
  mesh.vertices.emplace_back(0.F, 0.F, 1.F);
  for (int r = 1; r < rings; ++r) {
    for (int i = 0; i < around; ++i) {
      const double latitude = std::numbers::pi * r / rings;
      const double longitude = 2 * std::numbers::pi * i / around;
      mesh.vertices.push_back(Eigen::Vector3d(std::sin(latitude) * std::cos(longitude),
                                              std::sin(latitude) * std::sin(longitude),
                                              std::cos(latitude))
                                  .cast<float>());
    }
  }
  const auto index = [&](int r, int i) { return 1 + (r - 1) * around + i % around; };
  for (int i = 0; i < around; ++i) mesh.faces.push_back({0, index(1, i), index(1, i + 1)});
  for (int r = 1; r + 1 < rings - open; ++r) {
    for (int i = 0; i < around; ++i) {
      mesh.faces.push_back({index(r, i), index(r + 1, i), index(r + 1, i + 1)});
      mesh.faces.push_back({index(r, i), index(r + 1, i + 1), index(r, i + 1)});
    }
  }
  if (open == 0) {
    const int south = static_cast<int>(mesh.vertices.size());
    mesh.vertices.emplace_back(0.F, 0.F, -1.F);
    for (int i = 0; i < around; ++i)
      mesh.faces.push_back({south, index(rings - 1, i + 1), index(rings - 1, i)});
  }
  remove_unused_vertices(mesh);
  return mesh;
}

TEST(CloseHoles, MakesAClosedSurface) {
  SurfaceMesh mesh = globe(40, 60, 6);
  mesh.colors.assign(mesh.vertices.size(), cv::Vec3b(10, 20, 30));
  ASSERT_EQ(measure_surface(mesh).holes, 1);
  EXPECT_EQ(close_holes(mesh, 0.5), 0);  // the hole is wider
  EXPECT_EQ(close_holes(mesh, 2), 1);
  mesh.check();
  EXPECT_EQ(mesh.colors.back(), cv::Vec3b(10, 20, 30));
  const SurfaceMeasures measures = measure_surface(mesh);
  EXPECT_EQ(measures.holes, 0);
  EXPECT_EQ(measures.euler(), 2);
  // A sphere without a cap of height h.
  const double h = 1 - std::cos(std::numbers::pi * 6 / 40);
  const double truth = 4.0 / 3 * std::numbers::pi - std::numbers::pi * h * h * (3 - h) / 3;
  EXPECT_NEAR(measures.volume.value_or(0), truth, 0.02 * truth);
}

TEST(CloseHoles, ClosesTheSmallest) {
  SurfaceMesh mesh = globe(10, 12);
  mesh.faces.erase(mesh.faces.begin() + 40);                     // a hole of three edges
  mesh.faces.erase(mesh.faces.begin(), mesh.faces.begin() + 2);  // a hole of four
  EXPECT_EQ(close_holes(mesh, 10), 2);
  EXPECT_TRUE(measure_surface(mesh).volume.has_value());
}

TEST(SmoothSurface, RemovesNoiseAndKeepsTheVolume) {
  SurfaceMesh mesh = globe(50, 80);
  const double volume = measure_surface(mesh).volume.value_or(0);
  Rng rng(1);
  const auto roughness = [](const SurfaceMesh& rough) {
    double sum = 0;
    for (const Eigen::Vector3f& v : rough.vertices)
      sum += std::pow(static_cast<double>(v.norm()) - 1, 2);
    return std::sqrt(sum / static_cast<double>(rough.vertices.size()));
  };
  for (Eigen::Vector3f& v : mesh.vertices) v *= static_cast<float>(1 + 0.01 * rng.normal());
  const double before = roughness(mesh);
  SurfaceMesh other = mesh;
  cv::setNumThreads(1);
  smooth_surface(mesh, 10);
  cv::setNumThreads(4);
  smooth_surface(other, 10);
  cv::setNumThreads(-1);
  EXPECT_EQ(mesh.vertices, other.vertices);
  EXPECT_LT(roughness(mesh), 0.5 * before);
  EXPECT_NEAR(measure_surface(mesh).volume.value_or(0), volume, 0.005 * volume);
}

TEST(SmoothSurface, LeavesAStraightBoundaryWhereItIs) {
  SurfaceMesh mesh = globe(40, 60, 20);
  smooth_surface(mesh, 20);
  const SurfaceMeasures measures = measure_surface(mesh);
  EXPECT_EQ(measures.holes, 1);
  const BoundaryLoop loop = boundary_loops(mesh).at(0);
  for (const int v : loop.vertices)
    EXPECT_NEAR(mesh.vertices[static_cast<std::size_t>(v)][2], loop.center[2], 1e-4);
}

TEST(Decimate, KeepsASphere) {
  SurfaceMesh mesh = globe(100, 200);
  decimate(mesh, 2000, {});
  mesh.check();
  EXPECT_LE(mesh.faces.size(), 2000U);
  EXPECT_GE(mesh.faces.size(), 1998U);
  const SurfaceMeasures measures = measure_surface(mesh);
  EXPECT_EQ(measures.euler(), 2);
  EXPECT_EQ(measures.holes, 0);
  const double truth = 4.0 / 3 * std::numbers::pi;
  EXPECT_NEAR(measures.volume.value_or(0), truth, 0.005 * truth);
  for (const Eigen::Vector3f& v : mesh.vertices) EXPECT_NEAR(v.norm(), 1, 0.005);
  for (const Face& face : mesh.faces) {
    Eigen::Vector3f sum = Eigen::Vector3f::Zero();
    for (const int v : face) sum += mesh.vertices[static_cast<std::size_t>(v)];
    EXPECT_NEAR(sum.norm() / 3, 1, 0.01);
  }
}

TEST(Decimate, KeepsFlatPartsAndTheirBoundaryExactly) {
  SurfaceMesh mesh;  // a square of 40 x 40 cells
  for (int y = 0; y <= 40; ++y)
    for (int x = 0; x <= 40; ++x)
      mesh.vertices.emplace_back(static_cast<float>(x) * 0.1F, static_cast<float>(y) * 0.1F, 2.F);
  for (int y = 0; y < 40; ++y) {
    for (int x = 0; x < 40; ++x) {
      const int v = x + 41 * y;
      mesh.faces.push_back({v, v + 1, v + 42});
      mesh.faces.push_back({v, v + 42, v + 41});
    }
  }
  decimate(mesh, 20, {});
  EXPECT_LE(mesh.faces.size(), 20U);
  const SurfaceMeasures measures = measure_surface(mesh);
  EXPECT_NEAR(measures.area, 16, 0.01);
  EXPECT_NEAR(measures.hole_length, 16, 0.01);
  for (const Eigen::Vector3f& v : mesh.vertices) EXPECT_NEAR(v[2], 2, 1e-5);
}

TEST(Decimate, EndsWhenNoEdgeCanCollapse) {
  SurfaceMesh mesh = globe(10, 12);
  decimate(mesh, 1, {});
  mesh.check();
  EXPECT_GE(mesh.faces.size(), 4U);
  EXPECT_EQ(measure_surface(mesh).euler(), 2);
}

TEST(Decimate, Stops) {
  SurfaceMesh mesh = globe(20, 20);
  std::stop_source stop;
  stop.request_stop();
  EXPECT_THROW(decimate(mesh, 100, stop.get_token()), Interrupted);
}

}  // namespace
}  // namespace tarsier::sfm
