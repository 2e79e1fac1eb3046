// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <array>
#include <vector>

namespace tarsier::face::shape {

using Triangle = std::array<int, 3>;  // indices of points, of positive area in (x right, y down)

// Delaunay triangulation of points (2 x n) by incremental insertion (Bowyer 1981, Watson 1981):
// covers their convex hull, no point lies inside a triangle's circumcircle. Deterministic; each
// triangle starts with its least index and the list is sorted. Throws std::invalid_argument for
// fewer than 3 points, points that are not finite, coincide (within 1e-9 of the extent) or lie on
// one line.
[[nodiscard]] std::vector<Triangle> delaunay(const Eigen::Matrix2Xd& points);

// Triangles whose area has the other sign (or is 0) at `points` than in the mesh: the mesh folds.
[[nodiscard]] int folded(const std::vector<Triangle>& mesh, const Eigen::Matrix2Xd& points);

}  // namespace tarsier::face::shape
