// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <array>
#include <vector>

namespace tarsier::face::shape {

using Triangle = std::array<int, 3>;  // indices of points, with positive area (x right, y down)

// Delaunay triangulation of points (2 x n) by incremental insertion (Bowyer 1981, Watson 1981):
// covers their convex hull; no point is inside a triangle's circumcircle. Deterministic; each
// triangle starts with its smallest index, and the list is sorted. Throws std::invalid_argument for
// fewer than 3 points, or points that are not finite, coincide (within 1e-9 of the extent) or are
// collinear.
[[nodiscard]] std::vector<Triangle> delaunay(const Eigen::Matrix2Xd& points);

// Number of folded triangles: those whose area at `points` is 0 or has the opposite sign.
[[nodiscard]] int count_folded(const std::vector<Triangle>& mesh, const Eigen::Matrix2Xd& points);

}  // namespace tarsier::face::shape
