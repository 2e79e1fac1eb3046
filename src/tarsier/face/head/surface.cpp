// SPDX-License-Identifier: MIT
#include "tarsier/face/head/surface.h"

#include "tarsier/core/require.h"
#include "tarsier/face/shape/mesh.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace tarsier::face::head {
namespace {

constexpr int kRings = 16;
constexpr int kSegments = 32;

// The head above and behind the face, with the proportions of an adult's head. Unit: its half width
// (the farthest landmark from the plane of symmetry, about 74 mm). Depth 1.3 half widths, crown 1.5
// above the eyes.
void add_skull(HeadSurface& surface, const Eigen::Matrix3Xd& shape) {
  const double half = shape.row(0).cwiseAbs().maxCoeff();
  const Eigen::Vector3d radii(0.98 * half, 1.45 * half, 1.25 * half);
  // Its front is behind the brow: landmarks above the eye line near the middle.
  double front = 0;
  for (Eigen::Index i = 0; i < shape.cols(); ++i) {
    if (shape(1, i) < 0 && std::abs(shape(0, i)) < 0.4 * half) {
      front = std::min(front, shape(2, i));
    }
  }
  const Eigen::Vector3d center(0, -0.1 * half, front + 4 + radii[2]);
  const auto first = surface.points.cols();
  surface.points.conservativeResize(3, first + (kRings + 1) * kSegments);
  for (int ring = 0; ring <= kRings; ++ring) {
    const double down = std::numbers::pi * ring / kRings;
    for (int k = 0; k < kSegments; ++k) {
      const double turn = 2 * std::numbers::pi * k / kSegments;
      const Eigen::Vector3d unit(std::sin(down) * std::cos(turn), -std::cos(down),
                                 std::sin(down) * std::sin(turn));
      surface.points.col(first + ring * kSegments + k) = center + radii.cwiseProduct(unit);
    }
  }
  const auto at = [&](int ring, int k) {
    return static_cast<int>(first) + ring * kSegments + k % kSegments;
  };
  for (int ring = 0; ring < kRings; ++ring) {
    for (int k = 0; k < kSegments; ++k) {
      if (ring > 0) {
        surface.triangles.push_back({at(ring, k), at(ring + 1, k), at(ring, k + 1)});
      }
      if (ring + 1 < kRings) {
        surface.triangles.push_back({at(ring + 1, k), at(ring + 1, k + 1), at(ring, k + 1)});
      }
    }
  }
}

}  // namespace

HeadSurface head_surface(const HeadModel& model, const Eigen::Matrix3Xd& shape) {
  TARSIER_REQUIRE(shape.cols() == model.points() && shape.allFinite(),
                  "a shape of {} points for a head of {}", shape.cols(), model.points());
  HeadSurface surface;
  surface.points = shape;
  // Triangulate the mean, so that the surface of a head has the same triangles in every pose.
  for (const shape::Triangle& t : shape::delaunay(model.mean.topRows<2>())) {
    surface.triangles.push_back({t[0], t[2], t[1]});  // y is down: reversed, as seen from z < 0
  }
  add_skull(surface, shape);
  return surface;
}

}  // namespace tarsier::face::head
