// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/face/head/angles.h"
#include "tarsier/face/head/head_pose.h"
#include "tarsier/face/regression/training_face.h"
#include "tarsier/geometry/camera.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <optional>
#include <vector>

// Rotates annotated faces in 3D: makes images of tilted heads, with landmarks, from images of level
// ones (the idea: Zhu and others, "Face alignment across large poses: a 3D solution", CVPR 2016,
// section 5, "face profiling"). Landmark models that are trained on few heads looking up or down
// place the points of such heads as if they were level.
//
// The pose and shape of the head model are fitted to the annotated points. Each point x_i gets the
// depth Z_i of its model point m_i and becomes a point of this head, h_i = R^T (Z_i x_i - t), x_i
// as (x, y, 1) of the normalised image. In the pose R, t it projects exactly to its annotation. In
// the new pose it is at R' h_i + t.
//
// The mesh extends over the forehead and ends in a fixed ring around the face, so that the motion
// fades out in the background. The image is redrawn triangle by triangle, farthest first, without
// triangles that face away. Light and shade do not change.
//
// Points of the face's contour on the far side of a turned head are not fixed points of the skin:
// annotators mark where the cheek ends. In a horizontal section, the side of a head is
// approximately a quarter of an ellipse from the outline of the frontal view, at (a, z), a = |x|,
// forwards to (0, z - c), c = 0.8 a. Seen at a yaw psi its contour is at the angle phi = atan(c / a
// tan |psi|): m_i = (sign(x) a cos phi, y, z - c sin phi).
namespace tarsier::face::train {

struct TurnedFace {
  cv::Mat gray;             // of the size of the input
  Eigen::Matrix2Xd points;  // 2 x n, px
  head::HeadAngles before;  // of the head model fitted to the annotated points
  head::HeadAngles after;
};

class FaceTurner {
 public:
  // Throws std::invalid_argument for an invalid model.
  explicit FaceTurner(const head::HeadModel& head);

  [[nodiscard]] int points() const { return estimator_.model().points(); }

  // The face of `gray` (CV_8UC1) with `points` (2 x n px, in the order of the head's points),
  // rotated by these additional angles (as in head/angles.h: pitch + = up, yaw + = to image left;
  // the roll is kept). The centre of the points is kept. Empty if the points have no pose, for
  // angles beyond 80 degrees, and if more than 8 % of the face would be hidden, because annotators
  // would then mark other points. Throws std::invalid_argument for another type or number of
  // points.
  [[nodiscard]] std::optional<TurnedFace> turn(const cv::Mat& gray, const Eigen::Matrix2Xd& points,
                                               double pitch_deg, double yaw_deg) const;

  // `count` shapes (2 x n px) as predicted from an approximate pose: the head model in random poses
  // near that of `points`. The angles are multiplied by 0.6 to 1.1, plus noise of 5 degrees
  // (standard deviation). The shapes are between the mean and the face's own. Fewer if the points
  // have no pose. Deterministic by the seed.
  [[nodiscard]] std::vector<Eigen::Matrix2Xd> shapes_near(const Eigen::Matrix2Xd& points, int count,
                                                          std::uint64_t seed) const;

 private:
  head::HeadPoseEstimator estimator_;
};

struct CopyOptions {
  int copies = 1;  // per face
  // Rotation up or down by min_pitch_deg .. max_pitch_deg.
  double min_pitch_deg = 5;
  double max_pitch_deg = 30;
  double max_yaw_deg = 30;       // max sideways rotation, to both sides
  double farthest_yaw_deg = 50;  // max yaw of a copy, to both sides
  double farthest_pitch_deg = 40;
  // Max yaw by which a face is rotated back to the front: more would show parts that the camera did
  // not see.
  double max_back_deg = 10;
  int attempts = 5;  // random angles that are tried for a copy before it is skipped

  [[nodiscard]] OptionFields fields() {
    return {{"copies", copies, range(0, 20), "--turned",
             "number of copies of each face to add, rotated in 3D"},
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

// Rotated copies of a training face, marked as turned. Fewer than requested if all attempts hide
// too much or exceed the options. The face must have as many points as the turner. Deterministic by
// the seed.
[[nodiscard]] std::vector<regression::TrainingFace> turned_copies(
    const FaceTurner& turner, const regression::TrainingFace& face, const CopyOptions& options,
    std::uint64_t seed);

}  // namespace tarsier::face::train
