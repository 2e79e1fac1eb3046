// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/alpha_beta_filter.h"

#include "tarsier/core/require.h"

#include <algorithm>
#include <cmath>

namespace tarsier::face::landmarks {

namespace {
constexpr double kStep = 1.0 / 25;   // s
constexpr double kMemory = 0.4;      // weight of the newest value in the mean deviation
constexpr double kSpeedShare = 0.2;  // share of the critically damped beta, for calm motion
constexpr double kMaxGain = 0.9;
}  // namespace

Eigen::Matrix2Xd AlphaBetaFilter::next(const AlphaBetaFilterOptions& options,
                                       const Eigen::Matrix2Xd& points, double dt, double unit) {
  TARSIER_REQUIRE(dt > 0 && unit > 0, "dt {}, unit {}", dt, unit);
  if (!is_started_ || value_.cols() != points.cols()) {
    value_ = points;
    speed_ = Eigen::Matrix2Xd::Zero(2, points.cols());
    deviation_ = speed_;
    is_started_ = true;
    return value_;
  }
  const double steps = dt / kStep;
  const Eigen::Matrix2Xd predicted = value_ + speed_ * steps;
  const Eigen::Matrix2Xd innovation = points - predicted;
  deviation_ += (1 - std::pow(1 - kMemory, steps)) * (innovation / unit - deviation_);
  const Eigen::Vector2d face = deviation_.rowwise().mean();
  const double common =
      options.gain + options.face_gain * std::max(0.0, face.norm() - options.face_still);
  for (Eigen::Index p = 0; p < points.cols(); ++p) {
    const double own =
        options.point_gain * std::max(0.0, (deviation_.col(p) - face).norm() - options.point_still);
    const double gain = std::min(kMaxGain, common + own);
    const double alpha = 1 - std::pow(1 - gain, steps);
    const double beta = kSpeedShare * gain * gain / (2 - gain);
    value_.col(p) = predicted.col(p) + alpha * innovation.col(p);
    speed_.col(p) += beta * innovation.col(p);
  }
  return value_;
}

}  // namespace tarsier::face::landmarks
