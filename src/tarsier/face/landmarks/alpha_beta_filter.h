// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <Eigen/Core>

namespace tarsier::face::landmarks {

// Smoothing with little lag: an alpha-beta filter (position and speed; Benedict and Bordner, 1962).
// Its gain is low at rest and rises when fits deviate persistently from the prediction. It rises
// for the whole face when the face moves, or for a single point, for example when the lips part.
// (An exponential mean of the same steadiness lags nearly twice as far behind a moving head:
// docs/landmarks.md.)
struct AlphaBetaFilterOptions {
  double gain = 0.12;         // alpha per 1/25 s at rest
  double face_gain = 12;      // increase per unit of persistent deviation of the face
  double face_still = 0.025;  // units of deviation that count as rest
  double point_gain = 10;     // the same for a point relative to its face
  double point_still = 0.06;

  [[nodiscard]] OptionFields fields() {
    return {{"gain", gain, above(0, 1)},
            {"face_gain", face_gain, at_least(0)},
            {"face_still", face_still, at_least(0)},
            {"point_gain", point_gain, at_least(0)},
            {"point_still", point_still, at_least(0)}};
  }
  void check() const { check_fields(*this); }
};

class AlphaBetaFilter {
 public:
  // Smooths the points, `dt` seconds (> 0) after the previous ones; the first ones are returned
  // unchanged. `unit` (px, > 0) is the unit of deviations: an eye distance.
  [[nodiscard]] Eigen::Matrix2Xd next(const AlphaBetaFilterOptions& options,
                                      const Eigen::Matrix2Xd& points, double dt, double unit);
  void reset() { is_started_ = false; }

 private:
  bool is_started_ = false;
  Eigen::Matrix2Xd value_;
  Eigen::Matrix2Xd speed_;      // px per step of 1/25 s
  Eigen::Matrix2Xd deviation_;  // running mean of the deviation from the prediction, units
};

}  // namespace tarsier::face::landmarks
