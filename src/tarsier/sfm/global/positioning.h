// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <Eigen/Core>

#include <optional>
#include <stop_token>
#include <vector>

namespace tarsier::sfm {

// Cameras of known rotation, and the directions in which they see points.
struct PositioningProblem {
  struct Ray {
    int camera = 0;
    Eigen::Vector3d direction = Eigen::Vector3d::UnitZ();  // in world axes, length 1
  };
  int cameras = 0;
  // The rays ordered by point: those of point p are rays[first[p]] to rays[first[p + 1] - 1].
  std::vector<std::size_t> first;
  std::vector<Ray> rays;
};

struct PositioningOptions {
  int start_iterations = 15;
  int max_iterations = 60;  // for each of the two losses
  double loss = 0.1;        // sine of an angle: rays with larger errors get less weight
  double last_loss = 0.01;  // the same, in the final stage
  double tolerance = 1e-3;  // a stage stops when a step reduces the cost by less than this share
  double last_tolerance = 1e-4;  // the same, in the final stage

  [[nodiscard]] OptionFields fields() {
    return {{"start_iterations", start_iterations, range(1, 1000)},
            {"max_iterations", max_iterations, range(0, 1000)},
            {"loss", loss, range(1e-6, 1)},
            {"last_loss", last_loss, range(1e-6, 1)},
            {"tolerance", tolerance, range(1e-12, 0.1)},
            {"last_tolerance", last_tolerance, range(1e-12, 0.1)}};
  }
  void check() const { check_fields(*this); }
};

struct PositionedCameras {
  std::vector<Eigen::Vector3d> cameras;  // centres
  std::vector<Eigen::Vector3d> points;
  // per ray: the sine of its angle to the point; 1 where the point is behind the camera
  std::vector<double> errors;
  int iterations = 0;
};

// Computes the positions of all cameras and points together, without an initial guess. The result
// is defined up to a translation and a scale.
//
// The start is the convex problem of least unsquared deviations (Ozyesil and Singer, Robust camera
// location estimation by convex programming, CVPR 2015), with points as well as cameras,
//
//   min sum |X_k - c_i - s_ik v_ik|,  s_ik >= 1,
//
// solved by iteratively reweighted least squares. Then damped Gauss-Newton steps minimise the
// component of each unit ray that is perpendicular to the direction of its point,
//
//   sum rho(|v_ik - d_ik (X_k - c_i)|),  d_ik >= 0 the optimum for each ray,
//
// with Huber's loss (Zhuang, Cheong and Lee, Baseline desensitizing in translation averaging, CVPR
// 2018; Pan, Barath, Pollefeys and Schonberger, Global structure-from-motion revisited, ECCV 2024).
// The damping limits the changes of d_ik, not those of positions: a long chain of cameras can bend
// in a few steps.
// Points are eliminated; the cameras' equations are sparse. Uses one thread and no random numbers.
//
// Each point needs two or more rays. Empty where the equations have no solution. Throws
// std::invalid_argument for indices out of range, Interrupted.
[[nodiscard]] std::optional<PositionedCameras> position_cameras(
    const PositioningProblem& problem, const PositioningOptions& options = {},
    const std::stop_token& stop = {});

}  // namespace tarsier::sfm
