// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/head/factorization.h"
#include "tarsier/face/head/train_head.h"
#include "tarsier/face/shape/landmark_set.h"

#include <Eigen/Core>

#include <vector>

// The steps of train_head(), whose loop calls them.
namespace tarsier::face::head {

// The current estimate for one image; `moment` is E[(1, b)(1, b)'], b in units of its deviation.
struct TrainingView {
  Eigen::Matrix2Xd points;  // centred, RMS radius 1
  ScaledOrthography camera;
  Eigen::VectorXd b;
  Eigen::MatrixXd moment;
  Eigen::Matrix2Xd flat;    // the points under scaled orthography
  Eigen::VectorXd visible;  // 0..1: low on the outline's far side
  Eigen::VectorXd weight;   // visible times the robust weight
  Eigen::VectorXd squared;  // expected squared residual of each point
};

struct HeadTrainer {
  const TrainHeadOptions& options;
  const shape::Markup& markup;
  std::vector<char> is_outline;
  std::vector<TrainingView> views;
  Eigen::Matrix3Xd mean;  // mm
  Eigen::MatrixXd modes;  // 3n x m, scaled so that b has variance 1
  // Standard deviation of a coordinate of each point, in units of TrainingView::points.
  Eigen::VectorXd noise;
  Eigen::Index n = 0;
  Eigen::Index m = 0;

  [[nodiscard]] double distance() const { return options.distance_mm; }
  // The rigid head. Throws std::invalid_argument if the faces do not turn.
  void start();
  // Visibility of the outline by the current yaw. With yaw > 0 the head turns to image left, and
  // the outline at image left (x < 0) is the edge of the cheek instead of the jaw.
  void update_visibility(TrainingView& view) const;
  // Maximum a posteriori camera and deformation for the current shape (Gauss-Newton). Their
  // covariance gives the second moment of b.
  void estimate(TrainingView& view, int steps) const;
  // Least squares for the mean and the modes of each pair of points. The equations of the mirrored
  // point are those of this point with x reversed.
  void update_shape();
  // Fixes the gauge: b has mean 0 and variance 1; the modes do not move, rotate or scale the head
  // as a whole; the origin is midway between the eyes; the eye distance is given.
  void fix_gauge();
  void update_noise();
};

}  // namespace tarsier::face::head
