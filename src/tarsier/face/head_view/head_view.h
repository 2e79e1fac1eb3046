// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/head/angles.h"
#include "tarsier/face/head/head_model.h"
#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <array>
#include <optional>

// The appearance of a head whose approximate pose is known. It consists of an upright crop around
// the whole head (including hair, ears, neck and shoulders, which have no landmarks) as histograms
// of oriented gradients (Dalal and Triggs, CVPR 2005), and of the landmarks' offsets from the mean
// head in the approximate pose.
//
// The view's frame: origin and units of the camera's, z towards the centre of the head, by the
// smallest rotation from the camera's z. A head near the image border that looks into the camera is
// turned in the camera's frame, but not in the view's.
namespace tarsier::face::head_view {

inline constexpr int kSide = 120;  // px of the crop
inline constexpr int kCell = 12;   // px of a cell
inline constexpr int kCells = kSide / kCell;
inline constexpr int kOrientations = 9;  // of lines: opposite directions are the same
inline constexpr int kGradients = kCells * kCells * kOrientations;
inline constexpr double kSideMm = 280;  // side of the crop, at the head's distance

// The direction in which a head looks, with known roll. With the roll removed, the forward
// direction in the view's frame is (-sin yaw, -sin pitch cos yaw, -cos pitch cos yaw). Angles as in
// head/angles.h.
struct Direction {
  double pitch_deg = 0;
  double yaw_deg = 0;
};

struct HeadView {
  head::HeadAngles angles;  // of the approximate pose in the view's frame
  Eigen::Matrix3d camera_from_view = Eigen::Matrix3d::Zero();  // rotation
  // By row, column, orientation: line directions 180 / kOrientations degrees apart; the first one
  // is that of a vertical edge.
  Eigen::VectorXf gradients;
  // 2n, x0 y0 x1 ..: each landmark minus the projection of the mean head's, mm at the head's
  // distance, with the roll removed. Empty if the head model has no mirror symmetry.
  Eigen::VectorXf offsets;
  Eigen::VectorXf mirrored_offsets;  // those of the mirrored image
};

// `gray`: CV_8UC1 of the camera's size; `points`: 2 x n px, in the order of the head model's. Empty
// if the head is behind the camera or smaller than 16 px. Throws std::invalid_argument for another
// type, or another number of points.
[[nodiscard]] std::optional<HeadView> view_of_head(const cv::Mat& gray,
                                                   const geometry::Camera& camera,
                                                   const geometry::Rigid3& camera_from_head,
                                                   const head::HeadModel& head,
                                                   const Eigen::Matrix2Xd& points);

// The view of the mirrored image.
[[nodiscard]] HeadView mirrored(const HeadView& view);

// Direction of a unit vector in the view's frame, with the view's roll.
[[nodiscard]] Direction direction_of(const HeadView& view, const Eigen::Vector3d& forward_in_view);

// The rotation camera_from_head of a head that looks in this direction, with the view's roll.
[[nodiscard]] Eigen::Matrix3d rotation_towards(const HeadView& view, const Direction& direction);

// The histograms of an upright crop (CV_8UC1, kSide x kSide). Gradients of the square root of the
// brightness are shared linearly between two orientations and four cells. Each cell is normalised
// with each of the four 2 x 2 blocks that contain it, clipped to 0.2, and the four results are
// averaged.
[[nodiscard]] Eigen::VectorXf gradients_of(const cv::Mat& crop);

}  // namespace tarsier::face::head_view
