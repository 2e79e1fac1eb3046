// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/linalg/decompositions.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

// Finds the pose that minimises any sum of squares by Levenberg-Marquardt (Marquardt, "An algorithm
// for least-squares estimation of nonlinear parameters", 1963), over a small rotation w and a shift
// t: R <- exp([w]x) R and T <- T + t. It is a template so that the sums over the points are inlined
// into the loop.
namespace tarsier::geometry {

// For the residuals r as functions of (w, t): J' J, of which only the lower triangle is used, and
// J' r.
struct PoseEquations {
  Eigen::Matrix<double, 6, 6> normal = Eigen::Matrix<double, 6, 6>::Zero();
  Eigen::Matrix<double, 6, 1> gradient = Eigen::Matrix<double, 6, 1>::Zero();
};

struct RefinePoseOptions {
  int max_steps = 10;       // linearisations, >= 0
  int max_trials = 1000;    // maximum number of tried poses, >= 0
  double damping = 0;       // of the first step, relative to the diagonal, >= 0
  double tolerance = 1e-7;  // stops if a step reduces the cost by less than this share
};

struct RefinedPose {
  double cost = 0;         // infinite if the start has no finite cost
  bool converged = false;  // no step reduces the cost by more than the tolerance
};

// `cost(rotation, translation)`: the sum of squares; infinite for an impossible pose.
// `equations(rotation, translation)`: the PoseEquations at this pose. The cost never increases.
template <class Cost, class Equations>
RefinedPose refine_pose(Eigen::Matrix3d& rotation, Eigen::Vector3d& translation, const Cost& cost,
                        const Equations& equations, const RefinePoseOptions& options) {
  constexpr int kAttempts = 6;            // tried steps per linearisation
  constexpr double kFirstDamping = 1e-4;  // first damping after a failed step
  constexpr double kMinDamping = 1e-6;    // smaller damping is set to 0
  RefinedPose result;
  result.cost = cost(rotation, translation);
  double damping = options.damping;
  int trials = options.max_trials;
  for (int step = 0; step < options.max_steps && std::isfinite(result.cost); ++step) {
    const PoseEquations at = equations(rotation, translation);
    bool better = false;
    double gain = 0;
    for (int attempt = 0; attempt < kAttempts && trials > 0; ++attempt) {
      --trials;
      Eigen::Matrix<double, 6, 6> damped = at.normal;
      damped.diagonal() *= 1 + damping;
      const linalg::Cholesky factor(damped);  // reads the lower triangle
      if (factor.ok()) {
        const Eigen::Matrix<double, 6, 1> update = factor.solve(-at.gradient);
        const Eigen::Vector3d rotation_update = update.template head<3>();
        const double angle = rotation_update.norm();
        Eigen::Matrix3d turned = rotation;
        if (angle > 0)
          turned = Eigen::AngleAxisd(angle, rotation_update / angle).toRotationMatrix() * turned;
        const Eigen::Vector3d shifted = translation + update.template tail<3>();
        const double next = cost(turned, shifted);
        if (next <= result.cost) {
          gain = result.cost - next;
          result.cost = next;
          rotation = turned;
          translation = shifted;
          better = true;
          damping *= 0.1;
          if (damping < kMinDamping) damping = 0;
          break;
        }
      }
      damping = std::max(kFirstDamping, 10 * damping);
    }
    if (!better || gain <= options.tolerance * result.cost) {
      result.converged = true;
      break;
    }
  }
  return result;
}

}  // namespace tarsier::geometry
