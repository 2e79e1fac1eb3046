// SPDX-License-Identifier: MIT
#include "tarsier/face/head/surface.h"

#include "tarsier/face/head/testing_head.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <map>

namespace tarsier::face::head {
namespace {

TEST(HeadSurface, FaceTrianglesFaceTheCameraAndSkullIsClosed) {
  const HeadModel model = testing_head(3);
  const HeadSurface surface = head_surface(model, model.mean);
  const int n = model.points();
  ASSERT_GT(surface.points.cols(), n);
  EXPECT_TRUE(surface.points.leftCols(n).isApprox(model.mean));
  int facing = 0;
  int face = 0;
  std::map<std::pair<int, int>, int> edges;  // of the skull
  for (const auto& t : surface.triangles) {
    for (const int p : t) {
      ASSERT_GE(p, 0);
      ASSERT_LT(p, surface.points.cols());
    }
    const Eigen::Vector3d a = surface.points.col(t[0]);
    const Eigen::Vector3d normal =
        (surface.points.col(t[1]) - a).cross(surface.points.col(t[2]) - a);
    if (t[0] < n) {
      ++face;
      facing += normal[2] < 0 ? 1 : 0;
      continue;
    }
    const Eigen::Vector3d middle =
        surface.points.rightCols(surface.points.cols() - n).rowwise().mean();
    EXPECT_GT(normal.dot(a - middle), 0);  // outwards
    for (std::size_t k = 0; k < 3; ++k) ++edges[{t[k], t[(k + 1) % 3]}];
  }
  EXPECT_EQ(facing, face);
  EXPECT_GT(face, n);
  for (const auto& [edge, count] : edges) EXPECT_EQ(count, 1);  // each once in each direction
}

TEST(HeadSurface, TheSkullLiesBehindTheFaceAndAboveTheEyes) {
  const HeadModel model = testing_head(0);
  const HeadSurface surface = head_surface(model, model.mean);
  const Eigen::Matrix3Xd skull = surface.points.rightCols(surface.points.cols() - model.points());
  EXPECT_GT(skull.row(2).minCoeff(), model.mean.row(2).minCoeff());
  EXPECT_LT(skull.row(1).minCoeff(), -80);
  EXPECT_GT(skull.row(2).maxCoeff(), 100);
  EXPECT_LT(skull.row(0).cwiseAbs().maxCoeff(), 70);  // the outline is 70 mm from the middle
}

TEST(HeadSurface, RefusesAnotherNumberOfPoints) {
  const HeadModel model = testing_head(0);
  EXPECT_THROW((void)head_surface(model, model.mean.leftCols(5)), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::head
