// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/geometry/rigid3.h"
#include "tarsier/planar/calibration/board.h"

#include <Eigen/Core>

#include <functional>
#include <optional>
#include <stop_token>
#include <vector>

// Internals of calibrate(): least squares over a camera and the poses of its views.
namespace tarsier::planar::calibration {

// The points of one view, on the board (m) and in the image (px).
struct FitView {
  std::vector<cv::Point2d> board;
  std::vector<cv::Point2d> pixels;
  geometry::Rigid3 camera_from_board;
  bool used = true;
};

// The parameters of the camera that are fixed.
struct FitOptions {
  bool fix_aspect = false;      // fy = fx
  bool fix_center = false;      // cx, cy
  bool fix_tangential = false;  // p1, p2 stay 0 (not for a fisheye)
  int radial = 3;  // number of free radial coefficients, 0..3 (fisheye: 0..4); rational: all
  // Of Huber's loss, > 0: reduces the influence of outlier views and points.
  double loss_px = 0;
  int max_steps = 60;
};

// The number of parameters of a camera: fx fy cx cy and the coefficients of its lens.
[[nodiscard]] int parameter_count(const geometry::Camera& camera);

struct FitResult {
  double cost = 0;  // sum of (robust) squared residuals, px2
  // Of the parameters with the poses eliminated, 1/px2; 0 for fixed ones.
  Eigen::MatrixXd information;
  bool converged = false;
};

// Levenberg-Marquardt over the camera's parameters and the poses of all used views. Each pose is
// eliminated by its own 6 x 6 block (Schur complement). Derivatives are central differences. The
// poses must be near the solution (start_pose). Throws Interrupted.
[[nodiscard]] FitResult fit_lens(geometry::Camera& camera, std::vector<FitView>& views,
                                 const FitOptions& options, const std::stop_token& stop = {});

// The pose of a board in the view of a known camera. Empty if the points determine none (collinear,
// or outside the field of view of the lens).
[[nodiscard]] std::optional<geometry::Rigid3> start_pose(const geometry::Camera& camera,
                                                         const FitView& view);

// Projects a point of the board; empty if it is behind the camera.
[[nodiscard]] std::optional<cv::Point2d> board_pixel(const geometry::Camera& camera,
                                                     const geometry::Rigid3& camera_from_board,
                                                     const cv::Point2d& point);

// Root mean square reprojection error (px) of a view.
[[nodiscard]] double rms_of(const geometry::Camera& camera, const FitView& view);

}  // namespace tarsier::planar::calibration
