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

// The inside of calibrate(): least squares over a camera and the poses of its views.
namespace tarsier::planar::calibration {

// Points of one view: where they are on the board (m) and in the image (px).
struct FitView {
  std::vector<cv::Point2d> board;
  std::vector<cv::Point2d> pixels;
  geometry::Rigid3 camera_from_board;
  bool used = true;
};

// Which numbers of the camera stay as they are.
struct FitOptions {
  bool fix_aspect = false;   // fy = fx
  bool fix_center = false;   // cx, cy
  bool fix_tangent = false;  // p1, p2 stay 0 (not of a fisheye)
  int radial = 3;            // how many radial numbers move, 0..3 (fisheye: 0..4); rational: all
  double loss_px = 0;        // of Huber's loss, > 0: views and points that do not fit pull less
  int max_steps = 60;
};

// The numbers of a camera that the fit moves: fx fy cx cy, then its lens's coefficients.
[[nodiscard]] int number_count(const geometry::Camera& camera);

struct FitResult {
  double cost = 0;              // sum of (lossy) squared residuals, px2
  Eigen::MatrixXd information;  // of the numbers with the poses eliminated, 1/px2; fixed ones: 0
  bool converged = false;
};

// Levenberg and Marquardt over the camera's numbers and all poses of used views, each of which is
// eliminated by its own 6 x 6 block (Schur's complement). Derivatives are central differences.
// Poses must be near (start_pose). Throws Interrupted.
[[nodiscard]] FitResult fit_lens(geometry::Camera& camera, std::vector<FitView>& views,
                                 const FitOptions& options, const std::stop_token& stop = {});

// The pose of a board seen by a known camera; nothing where the points fix none (all on a line,
// outside of what the lens can see).
[[nodiscard]] std::optional<geometry::Rigid3> start_pose(const geometry::Camera& camera,
                                                         const FitView& view);

// Pixel of a point of the board; nothing behind the camera.
[[nodiscard]] std::optional<cv::Point2d> board_pixel(const geometry::Camera& camera,
                                                     const geometry::Rigid3& camera_from_board,
                                                     const cv::Point2d& point);

// Root of the mean squared distance (px) of a view's points from where they should be.
[[nodiscard]] double rms_of(const geometry::Camera& camera, const FitView& view);

}  // namespace tarsier::planar::calibration
