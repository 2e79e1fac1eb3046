// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

// The solids in the scenes of sfm_scene.h, and their intersection with rays. Internal to this
// module.
namespace tarsier::synth {

constexpr double kMaxDistance = 100;  // units: limit of the drawing distance

// Faces: 0..3 face -x, +x, -y and +y of the solid's own axes, 4 is the top, 5 the bottom. The side
// of a column is face 0; the slopes of a gable are faces 2 and 3.
constexpr int kTopFace = 4;
constexpr int kBottomFace = 5;

// An upright solid, rotated about z.
struct Solid {
  enum class Form {
    kBox,
    kColumn,  // round, of radius half[0]
    kGable,   // a roof with its ridge along its own x
  };
  Form form = Form::kBox;
  double x = 0;
  double y = 0;
  double half[2] = {};
  double bottom = 0;  // 0: stands on the ground
  double top = 0;
  double cosine = 1;
  double sine = 0;
  cv::Vec3f tint{1, 1, 1};

  [[nodiscard]] Eigen::Vector3d to_local(const Eigen::Vector3d& v) const {
    return {cosine * v[0] + sine * v[1], -sine * v[0] + cosine * v[1], v[2]};
  }
  [[nodiscard]] Eigen::Vector3d from_local(const Eigen::Vector3d& v) const {
    return {cosine * v[0] - sine * v[1], sine * v[0] + cosine * v[1], v[2]};
  }
  // Strictly inside; a solid on the ground continues below it.
  [[nodiscard]] bool contains(const Eigen::Vector3d& at) const;
  // Normal at a point of a face, in the solid's own axes.
  [[nodiscard]] Eigen::Vector3d normal(int face, const Eigen::Vector3d& local) const;
  // u to the right and v upwards as seen from outside, units from the face's centre.
  [[nodiscard]] cv::Point2d on_face(int face, const Eigen::Vector3d& local) const;
  // Width and height of a face, units.
  [[nodiscard]] cv::Size2d size_of(int face) const;
};

struct Hit {
  double t = kMaxDistance;
  int solid = -1;  // -1: the ground
  int face = 0;
  bool is_hit = false;
};

// Updates `hit` if the ray meets the solid of that number earlier. Origin and direction are in the
// solid's own axes. After T. L. Kay and J. T. Kajiya, "Ray tracing complex scenes", SIGGRAPH 1986:
// the part of the ray within all pairs of planes.
void intersect(const Solid& solid, int number, const Eigen::Vector3d& origin,
               const Eigen::Vector3d& direction, Hit& hit);

}  // namespace tarsier::synth
