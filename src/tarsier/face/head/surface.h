// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/head/head_model.h"

#include <Eigen/Core>

#include <array>
#include <vector>

namespace tarsier::face::head {

// A head as a closed-looking surface, to hide what is behind it: the face as the Delaunay mesh of
// the landmarks seen from the front, and a skull: an ellipsoid behind the eyes, as wide as the
// outline, which lies just inside the face where they meet. Roughly a head: no ears, no hair, no
// neck.
struct HeadSurface {
  Eigen::Matrix3Xd points;                    // mm, in the head's frame; the landmarks come first
  std::vector<std::array<int, 3>> triangles;  // counter-clockwise as seen from outside
};

// shape: 3 x n of the model (shape_of). Throws std::invalid_argument for another number of points
// and where the mean's landmarks coincide as seen from the front.
[[nodiscard]] HeadSurface head_surface(const HeadModel& model, const Eigen::Matrix3Xd& shape);

}  // namespace tarsier::face::head
