// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <algorithm>
#include <array>
#include <vector>

// The viewpoint that shows a whole reconstruction, shared by images and page.
namespace tarsier::sfm {

// The view frame of a cloud: x right, y up, z towards a viewer on the side of the cameras.
struct Framing {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();  // world; median of the points
  // rows: right, up and back as unit vectors of the world
  Eigen::Matrix3d base = Eigen::Matrix3d::Zero();
  // World units > 0, horizontal. It contains 95 % of the points, or is 1.6 times what contains 80 %
  // if that is less.
  double radius = 1;
  double half_height = 0;   // world units, vertical, by the same rule
  double cloud = 1;         // world units > 0, the larger of the two, without room for cameras
  double camera_size = .1;  // world units, depth of a drawn camera

  // World units; the larger of the two.
  [[nodiscard]] double scale() const { return std::max(radius, half_height); }
  // Coordinates in the frame, in world units.
  [[nodiscard]] Eigen::Vector3d framed(const Eigen::Vector3d& world) const {
    return base * (world - center);
  }
};

// A drawn camera: its centre and the four corners of its image, clockwise from the top left.
struct Pyramid {
  int image = 0;                            // index into Model::images
  std::array<Eigen::Vector3d, 5> vertices;  // world; the centre is the first
};
// Pairs of indices into Pyramid::vertices.
inline constexpr std::array<std::array<int, 2>, 8> kPyramidEdges{
    {{0, 1}, {0, 2}, {0, 3}, {0, 4}, {1, 2}, {2, 3}, {3, 4}, {4, 1}}};

// Up is opposite to the mean of the cameras' y axes; front is the mean viewing direction. A few
// outlier points have little influence. Numbers that are not finite are ignored. An empty model
// gives the unit frame. `with_cameras` makes room for nearby cameras.
[[nodiscard]] Framing frame_model(const Model& model, bool with_cameras = true);

// For all registered images whose numbers are finite.
[[nodiscard]] std::vector<Pyramid> camera_pyramids(const Model& model, const Framing& framing);

// Distance at which the framed part fills an image, in the unit of `radius` and `half_height`.
// `pitch`: radians; the tangents are those of half the angles of view.
[[nodiscard]] double fitting_distance(double radius, double half_height, double pitch,
                                      double tan_across, double tan_upright);

}  // namespace tarsier::sfm
