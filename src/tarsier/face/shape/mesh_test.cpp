// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/mesh.h"

#include "tarsier/core/rng.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>
#include <utility>

namespace tarsier::face::shape {
namespace {

using Eigen::Matrix2Xd;
using Eigen::Vector2d;

double cross(const Vector2d& a, const Vector2d& b, const Vector2d& c) {
  return (b.x() - a.x()) * (c.y() - a.y()) - (b.y() - a.y()) * (c.x() - a.x());
}

double hull_area(const Matrix2Xd& points) {
  std::vector<Vector2d> sorted;
  for (Eigen::Index i = 0; i < points.cols(); ++i) sorted.emplace_back(points.col(i));
  const auto before = [](const Vector2d& a, const Vector2d& b) {
    return std::pair(a.x(), a.y()) < std::pair(b.x(), b.y());
  };
  std::sort(sorted.begin(), sorted.end(), before);
  double area = 0;
  for (int half = 0; half < 2; ++half) {
    std::vector<Vector2d> hull;
    for (const Vector2d& p : sorted) {
      while (hull.size() >= 2 && cross(hull[hull.size() - 2], hull.back(), p) <= 0) hull.pop_back();
      hull.push_back(p);
    }
    for (std::size_t k = 1; k < hull.size(); ++k)
      area += (hull[k - 1].x() * hull[k].y() - hull[k - 1].y() * hull[k].x()) / 2;
    std::reverse(sorted.begin(), sorted.end());
  }
  return area;
}

// The guarantees of the header, up to rounding in this test.
void expect_delaunay(const Matrix2Xd& points, const std::vector<Triangle>& mesh) {
  EXPECT_EQ(count_folded(mesh, points), 0);
  EXPECT_TRUE(std::is_sorted(mesh.begin(), mesh.end()));
  double area = 0;
  std::map<std::pair<int, int>, int> edges;
  std::vector<bool> is_used(static_cast<std::size_t>(points.cols()), false);
  for (const Triangle& t : mesh) {
    EXPECT_EQ(t[0], *std::min_element(t.begin(), t.end()));
    const Vector2d a = points.col(t[0]);
    const Vector2d b = points.col(t[1]);
    const Vector2d c = points.col(t[2]);
    area += cross(a, b, c) / 2;
    for (std::size_t k = 0; k < 3; ++k) {
      EXPECT_EQ((++edges[{t[k], t[(k + 1) % 3]}]), 1) << "an edge twice in one direction";
      is_used[static_cast<std::size_t>(t[k])] = true;
    }
    // Circumcentre relative to a.
    const Vector2d u = b - a;
    const Vector2d v = c - a;
    const double d = 2 * (u.x() * v.y() - u.y() * v.x());
    const Vector2d centre((v.y() * u.squaredNorm() - u.y() * v.squaredNorm()) / d,
                          (u.x() * v.squaredNorm() - v.x() * u.squaredNorm()) / d);
    const double radius = centre.norm();
    for (Eigen::Index i = 0; i < points.cols(); ++i) {
      if (i == t[0] || i == t[1] || i == t[2]) continue;
      EXPECT_GE((Vector2d(points.col(i)) - a - centre).norm(), radius * (1 - 1e-6));
    }
  }
  EXPECT_NEAR(area, hull_area(points), 1e-9 * std::max(1.0, area));
  EXPECT_TRUE(std::all_of(is_used.begin(), is_used.end(), [](bool used) { return used; }));
}

TEST(Delaunay, CircumcirclesOfRandomPointsAreEmpty) {
  Rng rng(1);
  for (int k = 0; k < 60; ++k) {
    Matrix2Xd points(2, rng.integer(3, 60));
    for (Eigen::Index i = 0; i < points.size(); ++i) points.data()[i] = rng.uniform(-100, 300);
    expect_delaunay(points, delaunay(points));
  }
}

TEST(Delaunay, TriangulatesGrids) {
  for (const double angle : {0.0, 0.3, 1.1}) {
    Matrix2Xd points(2, 49);
    for (int i = 0; i < 49; ++i) {
      const Vector2d p(i % 7, i / 7);
      points.col(i) << std::cos(angle) * p.x() - std::sin(angle) * p.y(),
          std::sin(angle) * p.x() + std::cos(angle) * p.y();
    }
    const auto mesh = delaunay(points);
    // Hull points of a rotated grid are collinear up to rounding: thin triangles may remain there.
    if (angle == 0) {
      EXPECT_EQ(mesh.size(), 72U);
      expect_delaunay(points, mesh);
    }
    EXPECT_EQ(count_folded(mesh, points), 0);
    EXPECT_GE(mesh.size(), 72U);
  }
}

TEST(Delaunay, TriangulatesCollinearAndCocircularPoints) {
  Matrix2Xd edge(2, 5);
  edge << 0, 4, 2, 2, 1, 0, 0, 3, 0, 0;
  const auto mesh = delaunay(edge);
  expect_delaunay(edge, mesh);
  EXPECT_EQ(mesh.size(), 3U);
  Matrix2Xd circle(2, 12);
  for (int i = 0; i < 12; ++i) circle.col(i) << std::cos(i * 0.5), std::sin(i * 0.5);
  const auto fan = delaunay(circle);
  EXPECT_EQ(fan.size(), 10U);
  expect_delaunay(circle, fan);
}

TEST(Delaunay, IsInvariantToScaleAndTranslation) {
  Rng rng(2);
  Matrix2Xd points(2, 30);
  for (Eigen::Index i = 0; i < points.size(); ++i) points.data()[i] = rng.uniform();
  const auto mesh = delaunay(points);
  EXPECT_EQ(delaunay((points * 1e4).colwise() + Vector2d(1e5, -2e5)), mesh);
}

TEST(Delaunay, RejectsDegeneratePoints) {
  const auto refused = [](const Matrix2Xd& points) {
    EXPECT_THROW((void)delaunay(points), std::invalid_argument);
  };
  Matrix2Xd points(2, 4);
  points << 0, 1, 0, 5, 0, 0, 1, 5;
  EXPECT_NO_THROW((void)delaunay(points));
  refused(points.leftCols(2));
  refused(Matrix2Xd(2, 0));
  Matrix2Xd bad = points;
  bad(0, 2) = std::numeric_limits<double>::quiet_NaN();
  refused(bad);
  bad = points;
  bad.col(3) = bad.col(1) + Vector2d(0, 1e-12);
  refused(bad);
  Matrix2Xd line(2, 4);
  line << 0, 1, 2, 3, 1, 3, 5, 7;
  refused(line);
  refused(Matrix2Xd::Ones(2, 5));
}

TEST(CountFolded, CountsInvertedTriangles) {
  Matrix2Xd points(2, 4);
  points << 0, 4, 4, 0, 0, 0, 4, 4;
  const auto mesh = delaunay(points);
  ASSERT_EQ(mesh.size(), 2U);
  EXPECT_EQ(count_folded(mesh, points), 0);
  Matrix2Xd mirrored = points;
  mirrored.row(0) *= -1;
  EXPECT_EQ(count_folded(mesh, mirrored), 2);
  EXPECT_EQ(count_folded(mesh, Matrix2Xd::Zero(2, 4)), 2);
  EXPECT_THROW((void)count_folded(mesh, points.leftCols(3)), std::invalid_argument);
}

}  // namespace
}  // namespace tarsier::face::shape
