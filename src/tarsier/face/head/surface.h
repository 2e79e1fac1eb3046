// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/head/head_model.h"

#include <Eigen/Core>

#include <array>
#include <vector>

namespace tarsier::face::head {

// An approximate closed surface of a head, to hide objects behind it. The face is the frontal
// Delaunay mesh of the landmarks. The skull is an ellipsoid behind the eyes, as wide as the
// outline, slightly inside the face where they meet. It has no ears, hair or neck.
struct HeadSurface {
  Eigen::Matrix3Xd points;                    // mm, in the head's frame; the landmarks come first
  std::vector<std::array<int, 3>> triangles;  // counter-clockwise as seen from outside
};

// shape: 3 x n of the model (shape_of). Throws std::invalid_argument for another number of points,
// and if landmarks of the mean coincide in the frontal view.
[[nodiscard]] HeadSurface head_surface(const HeadModel& model, const Eigen::Matrix3Xd& shape);

}  // namespace tarsier::face::head
