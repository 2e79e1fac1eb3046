// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/sfm/bundle/bundle_cost.h"
#include "tarsier/sfm/bundle/bundle_solver.h"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <cstddef>

// Internal to bundle adjustment: residuals and their derivatives.
namespace tarsier::sfm {

constexpr double kMinDepth = 1e-6;  // of a point in front of a camera

// Computes the residual of an observation; false: the point is behind the camera. The derivatives
// by the position in the camera frame and by all lens parameters are optional.
inline bool residual_of(const BundleProblem::Measurement& seen, const LensParameters& lens,
                        const Eigen::Vector3d& in_camera, Eigen::Vector2d& residual,
                        Eigen::Matrix<double, 2, 3>* by_position,
                        Eigen::Matrix<double, 2, 9>* by_lens) {
  if (!(in_camera[2] >= kMinDepth)) return false;
  const double inverse = 1 / in_camera[2];
  const double x = in_camera[0] * inverse;
  const double y = in_camera[1] * inverse;
  const double r2 = x * x + y * y;
  const double k1 = lens[4];
  const double k2 = lens[5];
  const double p1 = lens[6];
  const double p2 = lens[7];
  const double k3 = lens[8];
  const double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
  const double xy = 2 * x * y;
  const double dx = x * radial + p1 * xy + p2 * (r2 + 2 * x * x);
  const double dy = y * radial + p1 * (r2 + 2 * y * y) + p2 * xy;
  const double fx = seen.weight * lens[0];
  const double fy = fx * lens[1];
  residual[0] = fx * dx + seen.weight * (lens[2] - seen.u);
  residual[1] = fy * dy + seen.weight * (lens[3] - seen.v);
  if (by_position != nullptr) {
    const double slope = k1 + r2 * (2 * k2 + r2 * 3 * k3);  // derivative of `radial` by r2
    const double mixed = xy * slope + 2 * (p1 * x + p2 * y);
    const double xx = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x;
    const double yy = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x;
    const double fxz = fx * inverse;
    const double fyz = fy * inverse;
    *by_position << fxz * xx, fxz * mixed, -fxz * (xx * x + mixed * y),  //
        fyz * mixed, fyz * yy, -fyz * (mixed * x + yy * y);
  }
  if (by_lens != nullptr) {
    const double w = seen.weight;
    const double r4 = r2 * r2;
    *by_lens << w * dx, 0, w, 0, fx * x * r2, fx * x * r4, fx * xy, fx * (r2 + 2 * x * x),
        fx * x * r2 * r4,  //
        w * lens[1] * dy, fx * dy, 0, w, fy * y * r2, fy * y * r4, fy * (r2 + 2 * y * y), fy * xy,
        fy * y * r2 * r4;
  }
  return true;
}

inline double prior_residual(const BundleProblem::CenterPrior& prior, const BundleState& state) {
  return prior.weight *
         (state.poses[static_cast<std::size_t>(prior.pose)].center()[prior.axis] - prior.value);
}

// Scales a residual and returns the factor for its derivatives. The squared loss then has the
// gradient and the second derivatives of Cauchy's loss. `curvature`: min ratio of the loss's
// curvature along the residual to that perpendicular to it.
inline void weigh(double loss_px, double curvature, Eigen::Vector2d& residual,
                  Eigen::Matrix2d& factor) {
  factor.setIdentity();
  const double c2 = loss_px * loss_px;
  const double squares = residual.squaredNorm();
  if (c2 <= 0 || squares <= 0) return;
  const double x = squares / c2;
  const double slope = 1 / (1 + x);                                     // rho'
  const double along = std::max(curvature, (1 - x) / (1 + x)) * slope;  // rho' + 2 s rho''
  const Eigen::Vector2d unit = residual / std::sqrt(squares);
  factor = std::sqrt(slope) * Eigen::Matrix2d::Identity() +
           (std::sqrt(along) - std::sqrt(slope)) * unit * unit.transpose();
  residual *= slope / std::sqrt(along);
}

}  // namespace tarsier::sfm
