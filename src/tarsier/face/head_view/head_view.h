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

// What a camera sees of a head whose pose is roughly known: an upright crop around the whole head
// (hair, ears, neck and shoulders too, which landmarks do not have), as histograms of oriented
// gradients (Dalal and Triggs, CVPR 2005), and how the face's landmarks lie beside those of the
// mean head in the rough pose.
//
// The view's frame: origin and units of the camera's, z towards the middle of the head, by the
// smallest rotation from the camera's z. A head at the image's rim that looks into the camera is
// turned in the camera's frame, not in the view's.
namespace tarsier::face::head_view {

inline constexpr int kSide = 120;  // px of the crop
inline constexpr int kCell = 12;   // px of a cell
inline constexpr int kCells = kSide / kCell;
inline constexpr int kOrientations = 9;  // of lines: a direction and its opposite are one
inline constexpr int kGradients = kCells * kCells * kOrientations;
inline constexpr double kSideMm = 280;  // of the crop, at the head's distance

// Where a head looks, its roll being known: the forward direction in the view's frame, the roll
// taken out, is (-sin yaw, -sin pitch cos yaw, -cos pitch cos yaw). Those of head/angles.h.
struct Direction {
  double pitch_deg = 0;
  double yaw_deg = 0;
};

struct HeadView {
  head::HeadAngles angles;  // of the rough pose in the view's frame
  Eigen::Matrix3d camera_from_view = Eigen::Matrix3d::Zero();  // rotation
  // By row, column, orientation: line directions 180 / kOrientations degrees apart, the first that
  // of a vertical edge.
  Eigen::VectorXf gradients;
  // 2n, x0 y0 x1 ..: each landmark less the projection of the mean head's, mm at the head's
  // distance, the roll taken out. Empty where the head model does not know left from right.
  Eigen::VectorXf offsets;
  Eigen::VectorXf mirrored_offsets;  // those of the mirrored image
};

// `gray`: CV_8UC1 of the camera's size; `points`: 2 x n px, in the order of the head model's.
// Nothing where the head is behind the camera or smaller than 16 px. Throws std::invalid_argument
// for another type, or another number of points.
[[nodiscard]] std::optional<HeadView> view_of_head(const cv::Mat& gray,
                                                   const geometry::Camera& camera,
                                                   const geometry::Rigid3& camera_from_head,
                                                   const head::HeadModel& head,
                                                   const Eigen::Matrix2Xd& points);

// As a mirror shows it.
[[nodiscard]] HeadView mirrored(const HeadView& view);

// Of a unit vector in the view's frame, with the view's roll.
[[nodiscard]] Direction direction_of(const HeadView& view, const Eigen::Vector3d& forward_in_view);

// The rotation camera_from_head of the head that looks there, with the view's roll.
[[nodiscard]] Eigen::Matrix3d rotation_towards(const HeadView& view, const Direction& direction);

// The histograms of an upright crop (CV_8UC1, kSide x kSide): gradients of the root of the
// brightness, each shared between the two next orientations and the four next cells; each cell
// normalised with the four blocks of 2 x 2 cells that it is part of, parts at most 0.2, the mean of
// the four.
[[nodiscard]] Eigen::VectorXf gradients_of(const cv::Mat& crop);

}  // namespace tarsier::face::head_view
