// SPDX-License-Identifier: MIT
#include "tarsier/sfm/surface/surface_mesh.h"

#include <gtest/gtest.h>

#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>

namespace tarsier::sfm {
namespace {

// A box of sides 2, 3 and 4.
SurfaceMesh box() {
  SurfaceMesh mesh;
  for (int c = 0; c < 8; ++c)
    mesh.vertices.emplace_back(2.F * static_cast<float>(c & 1),
                               3.F * static_cast<float>(c >> 1 & 1),
                               4.F * static_cast<float>(c >> 2));
  mesh.faces = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return mesh;
}

TEST(SurfaceMesh, MeasuresABox) {
  const SurfaceMeasures measures = measure_surface(box());
  EXPECT_EQ(measures.vertices, 8);
  EXPECT_EQ(measures.edges, 18);
  EXPECT_EQ(measures.euler(), 2);
  EXPECT_EQ(measures.parts, 1);
  EXPECT_EQ(measures.holes, 0);
  EXPECT_NEAR(measures.area, 2 * (6 + 8 + 12), 1e-9);
  ASSERT_TRUE(measures.volume.has_value());
  EXPECT_NEAR(*measures.volume, 24, 1e-9);
  EXPECT_EQ(to_json(measures)["extent"], nlohmann::json({2.0, 3.0, 4.0}));
}

TEST(SurfaceMesh, ListsHoles) {
  SurfaceMesh mesh = box();
  mesh.faces.erase(mesh.faces.begin() + 2, mesh.faces.begin() + 4);  // the lid
  const std::vector<BoundaryLoop> loops = boundary_loops(mesh);
  ASSERT_EQ(loops.size(), 1U);
  EXPECT_EQ(loops[0].vertices.size(), 4U);
  EXPECT_NEAR(loops[0].length, 10, 1e-6);
  EXPECT_NEAR(loops[0].diameter, std::sqrt(13.0), 1e-6);
  EXPECT_NEAR((loops[0].center - Eigen::Vector3d(1, 1.5, 4)).norm(), 0, 1e-6);
  const SurfaceMeasures measures = measure_surface(mesh);
  EXPECT_FALSE(measures.volume.has_value());
  EXPECT_EQ(to_json(measures)["volume"], nullptr);
  EXPECT_EQ(to_json(measures)["closed"], false);
}

TEST(SurfaceMesh, SplitsVerticesSharedByTwoFans) {
  SurfaceMesh mesh;  // two triangles that share one corner
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {-1, 0, 0}, {0, -1, 0}};
  mesh.faces = {{0, 1, 2}, {0, 3, 4}};
  EXPECT_EQ(split_touching_vertices(mesh), 1);
  EXPECT_EQ(mesh.vertices.size(), 6U);
  EXPECT_EQ(boundary_loops(mesh).size(), 2U);
  EXPECT_EQ(split_touching_vertices(mesh), 0);
}

TEST(SurfaceMesh, RemovesSmallParts) {
  SurfaceMesh mesh = box();
  mesh.vertices.insert(mesh.vertices.end(), {{9, 9, 9}, {9, 9, 8}, {9, 8, 9}});
  mesh.faces.push_back({8, 9, 10});
  EXPECT_EQ(measure_surface(mesh).parts, 2);
  SurfaceMesh same = mesh;
  EXPECT_EQ(remove_small_parts(same, 0.05), 0);
  EXPECT_EQ(remove_small_parts(mesh, 0.5), 1);
  EXPECT_EQ(mesh.faces, box().faces);
  EXPECT_EQ(mesh.vertices.size(), 8U);
}

TEST(SurfaceMesh, CheckRefusesInvalidMeshes) {
  SurfaceMesh mesh = box();
  EXPECT_NO_THROW(mesh.check());
  mesh.faces[3][1] = 8;
  EXPECT_THROW(mesh.check(), std::invalid_argument);
  mesh = box();
  mesh.faces[3][1] = mesh.faces[3][0];
  EXPECT_THROW(mesh.check(), std::invalid_argument);
  mesh = box();
  mesh.vertices[2][1] = std::numeric_limits<float>::quiet_NaN();
  EXPECT_THROW(mesh.check(), std::invalid_argument);
}

TEST(SurfaceMesh, AnEmptyMeshHasNoMeasures) {
  const SurfaceMeasures measures = measure_surface({});
  EXPECT_EQ(measures.faces, 0);
  EXPECT_FALSE(measures.volume.has_value());
}

}  // namespace
}  // namespace tarsier::sfm
