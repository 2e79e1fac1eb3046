// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/head/angles.h"
#include "tarsier/face/head/head_pose.h"
#include "tarsier/face/landmarks/training_face.h"
#include "tarsier/geometry/camera.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <optional>
#include <vector>

// Annotated faces turned in 3D: images of tilted heads, with their points, from images of level
// ones (the idea: Zhu and others, "Face alignment across large poses: a 3D solution", CVPR 2016,
// section 5, "face profiling"). Landmark models that see few heads that look up or down place the
// points of such heads as if they were level; what is missing can be made.
//
// The pose and shape of the head model are fitted to the annotated points. Each point x_i gets the
// depth Z_i of its model point m_i and becomes a point of this head, h_i = R^T (Z_i x_i - t), x_i
// as (x, y, 1) of the normalised image: seen in the pose R, t it is exactly where it was
// annotated. In the new pose it is at R' h_i + t. Around the face the mesh goes on over the
// forehead and ends in a ring that stays where it was, so that the motion fades out in the
// background. The image is drawn again triangle by triangle, far ones first, those that would
// show their back left out; light and shade stay as they were.
//
// Points of the face's contour on the far side of a turned head are no fixed points of the skin:
// annotators mark where the cheek ends. Cut by a level plane, the side of a head is roughly a
// quarter of an ellipse from the outline of the frontal view, at (a, z), a = |x|, forwards to
// (0, z - c), c = 0.8 a. Seen at a yaw psi its contour is at the angle
// phi = atan(c / a tan |psi|): m_i = (sign(x) a cos phi, y, z - c sin phi).
namespace tarsier::face::train {

struct Turned {
  cv::Mat gray;             // of the size of what was given
  Eigen::Matrix2Xd points;  // 2 x n, px
  head::HeadAngles before;  // as the head model sees the annotated points
  head::HeadAngles after;
};

class FaceTurner {
 public:
  // Throws std::invalid_argument where the model does not pass its check.
  explicit FaceTurner(const head::HeadModel& head);

  [[nodiscard]] int points() const { return poser_.model().points(); }

  // The face of `gray` (CV_8UC1) with `points` (2 x n px, in the order of the head's points),
  // turned by so many degrees more (as in head/angles.h: pitch + = up, yaw + = to image left; the
  // roll stays). The middle of the points stays where it is. Nothing where the points have no pose,
  // for angles beyond 80 degrees, and where more than 8 % of the face would go out of sight: what
  // is left of it is no longer what an annotator would mark. Throws std::invalid_argument for
  // another type or number of points.
  [[nodiscard]] std::optional<Turned> turn(const cv::Mat& gray, const Eigen::Matrix2Xd& points,
                                           double pitch_deg, double yaw_deg) const;

  // `count` shapes as one that knows the pose roughly sees them (2 x n px): the head model in poses
  // near that of `points`, 40 % nearer to straight to 10 % further, and 5 degrees (standard
  // deviation) beside it, between the mean shape and the face's own. Fewer where the points have no
  // pose. The same for the same seed.
  [[nodiscard]] std::vector<Eigen::Matrix2Xd> shapes_near(const Eigen::Matrix2Xd& points, int count,
                                                          std::uint64_t seed) const;

 private:
  head::HeadPoser poser_;
};

struct CopyOptions {
  int copies = 1;            // of each face
  double min_pitch_deg = 5;  // turned up or down by least .. most
  double max_pitch_deg = 30;
  double max_yaw_deg = 30;       // turned sideways by up to this, either way
  double farthest_yaw_deg = 50;  // no copy is turned further, either way
  double farthest_pitch_deg = 40;
  // A yaw that turns the face back by more than this shows what no camera saw.
  double max_back_deg = 10;
  int attempts = 5;  // angles that are tried for a copy before it is left out

  [[nodiscard]] OptionFields fields() {
    return {{"copies", copies, range(0, 20), "--turned",
             "copies of each face, turned in 3D, to learn from beside it"},
            {"min_pitch_deg", min_pitch_deg, range(0, 45)},
            {"max_pitch_deg", max_pitch_deg, range(0, 45)},
            {"max_yaw_deg", max_yaw_deg, range(0, 45)},
            {"farthest_yaw_deg", farthest_yaw_deg, range(0, 80)},
            {"farthest_pitch_deg", farthest_pitch_deg, range(0, 80)},
            {"max_back_deg", max_back_deg, range(0, 90)},
            {"attempts", attempts, range(1, 100)}};
  }
  void check() const;
};

// Turned copies of a training face, marked as such; fewer than asked for where all attempts hide
// too much or lead beyond the options.
// The face's points must be as many as the turner's. The same for the same seed.
[[nodiscard]] std::vector<landmarks::TrainingFace> turned_copies(
    const FaceTurner& turner, const landmarks::TrainingFace& face, const CopyOptions& options,
    std::uint64_t seed);

}  // namespace tarsier::face::train
