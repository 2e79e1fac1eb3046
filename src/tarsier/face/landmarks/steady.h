// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <Eigen/Core>

namespace tarsier::face::landmarks {

// Smoothing that hardly lags: an alpha-beta filter (position and speed; Benedict and Bordner, 1962)
// whose gain is low at rest and rises where fits stay off what is predicted: of the whole face as
// it starts to move, of a point by itself as lips part. (An exponential mean as steady as this lags
// nearly twice as far behind a moving head: docs/landmarks.md.)
struct SteadyOptions {
  double gain = 0.12;         // alpha of 1/25 s at rest
  double face_gain = 12;      // more for each unit that the face is off persistently
  double face_still = 0.025;  // units that count as rest
  double point_gain = 10;     // the same of a point against its face
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

class Steady {
 public:
  // The smoothed points `dt` seconds (> 0) after those before; the first are taken as they are.
  // `unit` (px, > 0) is what "off" is measured in: an eye distance.
  [[nodiscard]] Eigen::Matrix2Xd next(const SteadyOptions& options, const Eigen::Matrix2Xd& points,
                                      double dt, double unit);
  void reset() { has_ = false; }

 private:
  bool has_ = false;
  Eigen::Matrix2Xd value_;
  Eigen::Matrix2Xd speed_;  // px a step of 1/25 s
  Eigen::Matrix2Xd off_;    // mean of what was not predicted, units
};

}  // namespace tarsier::face::landmarks
