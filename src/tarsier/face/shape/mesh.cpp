// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/mesh.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

namespace tarsier::face::shape {
namespace {

using Real = long double;  // the in-circle test subtracts fourth powers

// Twice the area of a, b, c; positive if they turn from x towards y.
Real cross(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
  return (static_cast<Real>(b.x()) - a.x()) * (static_cast<Real>(c.y()) - a.y()) -
         (static_cast<Real>(b.y()) - a.y()) * (static_cast<Real>(c.x()) - a.x());
}

// Positive if d is inside the circle through a, b, c (of positive area).
Real in_circle(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c,
               const Eigen::Vector2d& d) {
  const auto dx = [&](const Eigen::Vector2d& p) { return static_cast<Real>(p.x()) - d.x(); };
  const auto dy = [&](const Eigen::Vector2d& p) { return static_cast<Real>(p.y()) - d.y(); };
  const auto square = [&](const Eigen::Vector2d& p) { return dx(p) * dx(p) + dy(p) * dy(p); };
  return square(a) * (dx(b) * dy(c) - dy(b) * dx(c)) - square(b) * (dx(a) * dy(c) - dy(a) * dx(c)) +
         square(c) * (dx(a) * dy(b) - dy(a) * dx(b));
}

// One ghost point at infinity is used instead of three distant points, which would distort the
// hull. A triangle (u, v, kGhost) is the half plane outside the hull's edge u -> v.
constexpr int kGhost = -1;
using Edge = std::pair<int, int>;

class Delaunay {
 public:
  explicit Delaunay(const Eigen::Matrix2Xd& points) : points_(points) {}

  std::vector<Triangle> run() {
    const auto order = start();
    for (const int p : order) insert(p);
    std::vector<Triangle> mesh;
    for (Triangle triangle : triangles_) {
      if (triangle[0] == kGhost || triangle[1] == kGhost || triangle[2] == kGhost) continue;
      std::rotate(triangle.begin(), std::min_element(triangle.begin(), triangle.end()),
                  triangle.end());
      mesh.push_back(triangle);
    }
    std::sort(mesh.begin(), mesh.end());
    return mesh;
  }

 private:
  [[nodiscard]] Eigen::Vector2d at(int i) const { return points_.col(i); }

  // Creates the first triangle from two distant points and the one farthest from their line.
  // Returns the others.
  std::vector<int> start() {
    const int n = static_cast<int>(points_.cols());
    const auto farthest = [&](const auto& measure) {
      int best = 0;
      for (int i = 1; i < n; ++i)
        if (measure(i) > measure(best)) best = i;
      return best;
    };
    const int a = 0;
    const int b = farthest([&](int i) { return (at(i) - at(a)).squaredNorm(); });
    int c = farthest([&](int i) { return std::abs(cross(at(a), at(b), at(i))); });
    const double extent2 = (at(b) - at(a)).squaredNorm();
    TARSIER_REQUIRE(std::abs(cross(at(a), at(b), at(c))) > 1e-9L * extent2,
                    "points that lie on one line");
    int second = b;
    if (cross(at(a), at(second), at(c)) < 0) std::swap(second, c);
    triangles_ = {{a, second, c}, {second, a, kGhost}, {c, second, kGhost}, {a, c, kGhost}};
    std::vector<int> rest;
    for (int i = 0; i < n; ++i)
      if (i != a && i != second && i != c) rest.push_back(i);
    return rest;
  }

  // Whether p is in the circumcircle. For a ghost triangle this is the half plane outside its edge,
  // and the edge itself.
  [[nodiscard]] bool is_hit(const Triangle& triangle, int p) const {
    if (triangle[2] != kGhost)
      return in_circle(at(triangle[0]), at(triangle[1]), at(triangle[2]), at(p)) > 0;
    // A ghost's edge has the outside of the hull on its positive side.
    const Eigen::Vector2d u = at(triangle[0]);
    const Eigen::Vector2d v = at(triangle[1]);
    const Real side = cross(u, v, at(p));
    if (side != 0) return side > 0;
    return (at(p) - u).dot(at(p) - v) < 0;
  }

  void insert(int p) {
    // The edges that occur once are the boundary of the hole; they keep their direction.
    std::set<Edge> edges;
    std::vector<Triangle> kept;
    for (const Triangle& triangle : triangles_) {
      if (!is_hit(triangle, p)) {
        kept.push_back(triangle);
        continue;
      }
      for (std::size_t k = 0; k < 3; ++k) edges.insert({triangle[k], triangle[(k + 1) % 3]});
    }
    triangles_ = std::move(kept);
    for (const auto& [u, v] : edges) {
      if (edges.contains({v, u})) continue;
      // The ghost point is always the last one.
      if (u == kGhost)
        triangles_.push_back({v, p, kGhost});
      else if (v == kGhost)
        triangles_.push_back({p, u, kGhost});
      else
        triangles_.push_back({u, v, p});
    }
  }

  const Eigen::Matrix2Xd& points_;
  std::vector<Triangle> triangles_;
};

void check_distinct(const Eigen::Matrix2Xd& points) {
  const double extent = (points.rowwise().maxCoeff() - points.rowwise().minCoeff()).maxCoeff();
  TARSIER_REQUIRE(extent > 0, "points that coincide");
  const double min_distance = 1e-9 * extent;
  std::vector<int> order(static_cast<std::size_t>(points.cols()));
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = static_cast<int>(i);
  std::sort(order.begin(), order.end(),
            [&](int a, int b) { return std::pair(points(0, a), a) < std::pair(points(0, b), b); });
  for (std::size_t i = 0; i < order.size(); ++i) {
    for (std::size_t k = i + 1; k < order.size(); ++k) {
      const Eigen::Vector2d step = points.col(order[k]) - points.col(order[i]);
      if (step.x() > min_distance) break;
      TARSIER_REQUIRE(step.norm() > min_distance, "points {} and {} coincide",
                      std::min(order[i], order[k]), std::max(order[i], order[k]));
    }
  }
}

}  // namespace

std::vector<Triangle> delaunay(const Eigen::Matrix2Xd& points) {
  TARSIER_REQUIRE(points.cols() >= 3, "{} points; three are needed", points.cols());
  TARSIER_REQUIRE(points.allFinite(), "a point is not finite");
  check_distinct(points);
  return Delaunay(points).run();
}

int count_folded(const std::vector<Triangle>& mesh, const Eigen::Matrix2Xd& points) {
  int count = 0;
  for (const auto& [a, b, c] : mesh) {
    TARSIER_REQUIRE(
        a >= 0 && b >= 0 && c >= 0 && a < points.cols() && b < points.cols() && c < points.cols(),
        "a triangle of points {}, {}, {} of {}", a, b, c, points.cols());
    // Also counts NaN: an area that cannot be computed is treated as folded.
    if (!(cross(points.col(a), points.col(b), points.col(c)) > 0)) ++count;
  }
  return count;
}

}  // namespace tarsier::face::shape
