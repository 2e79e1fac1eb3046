// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/scene/model.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <algorithm>
#include <array>
#include <vector>

// Where to stand to see a reconstruction whole: shared by the images and the page.
namespace tarsier::sfm {

// The frame of a cloud: x right, y up, z towards who looks at it from where the cameras stood.
struct Framing {
  Eigen::Vector3d center = Eigen::Vector3d::Zero();  // world; median of the points
  Eigen::Matrix3d base =
      Eigen::Matrix3d::Zero();  // its rows are right, up and back as unit vectors of the world
  double radius = 1;            // world units > 0, across: 95 % of the points lie within, or
                                // 1.6 times what 80 % lie within where that is less
  double half_height = 0;       // world units, upright, alike
  double cloud = 1;             // world units > 0, the larger of the two, without room for cameras
  double camera_size = .1;      // world units, depth of a drawn camera

  // World units; the larger of the two.
  [[nodiscard]] double scale() const { return std::max(radius, half_height); }
  // Coordinates in the frame, in world units.
  [[nodiscard]] Eigen::Vector3d framed(const Eigen::Vector3d& world) const {
    return base * (world - center);
  }
};

// A camera as drawn: its centre and the four corners of its image, from the top left clockwise.
struct Pyramid {
  int image = 0;                            // index into Model::images
  std::array<Eigen::Vector3d, 5> vertices;  // world; the centre first
};
// Pairs of indices into Pyramid::vertices.
inline constexpr std::array<std::array<int, 2>, 8> kPyramidEdges{
    {{0, 1}, {0, 2}, {0, 3}, {0, 4}, {1, 2}, {2, 3}, {3, 4}, {4, 1}}};

// Up is against the mean of the cameras' y axes, front where they look on average. A few stray
// points change it hardly. Numbers that are not finite are passed over; a model with nothing in it
// gives the unit frame. `with_cameras` makes room for them, as far as they stand near.
[[nodiscard]] Framing frame_model(const Model& model, bool with_cameras = true);

// Of all registered images whose numbers are finite.
[[nodiscard]] std::vector<Pyramid> camera_pyramids(const Model& model, const Framing& framing);

// Distance at which the framed part fills an image, in the unit of `radius` and `half_height`.
// `pitch` radians; the tangents are of half the angles of view.
[[nodiscard]] double fitting_distance(double radius, double half_height, double pitch,
                                      double tan_across, double tan_upright);

}  // namespace tarsier::sfm
