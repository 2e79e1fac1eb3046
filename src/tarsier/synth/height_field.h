// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/synth/relief_texture.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

// The surface of relief.h.
namespace tarsier::synth {

constexpr double kReliefDepth = 2;  // units

// z over (x, y): a quadratic B-spline, so that height and slope are exact and smooth.
class HeightField {
 public:
  HeightField() = default;  // flat

  explicit HeightField(const Rng& base);

  [[nodiscard]] bool is_flat() const { return values_.empty(); }

  [[nodiscard]] double height(double x, double y) const {
    if (is_flat()) return 0;
    const Weights u(x);
    const Weights v(y);
    double sum = 0;
    for (int j = 0; j < 3; ++j) {
      const double* row = values_[(v.first + j) & (kRows - 1)];
      double line = 0;
      for (int i = 0; i < 3; ++i) line += u.value[i] * row[(u.first + i) & (kCols - 1)];
      sum += v.value[j] * line;
    }
    return sum;
  }

  [[nodiscard]] cv::Vec2d slope(double x, double y) const {
    if (is_flat()) return {0, 0};
    const Weights u(x);
    const Weights v(y);
    cv::Vec2d sum{0, 0};
    for (int j = 0; j < 3; ++j) {
      const double* row = values_[(v.first + j) & (kRows - 1)];
      for (int i = 0; i < 3; ++i) {
        const double value = row[(u.first + i) & (kCols - 1)];
        sum[0] += u.slope(i) * v.value[j] * value;
        sum[1] += u.value[i] * v.slope(j) * value;
      }
    }
    return sum / kSpacing;
  }

  // The first t < limit where origin + t * direction meets the surface from above; `limit` if none.
  [[nodiscard]] double first_hit(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                 double limit) const;

 private:
  static constexpr int kCols = 256;  // powers of 2
  static constexpr int kRows = 128;
  static constexpr double kSpacing = 0.2;

  struct Weights {
    explicit Weights(double x) {
      const double u = x / kSpacing;
      const int nearest = floor_of(u + 0.5);
      f = u - nearest;
      first = nearest - 1;
      value[0] = 0.5 * (0.5 - f) * (0.5 - f);
      value[1] = 0.75 - f * f;
      value[2] = 0.5 * (0.5 + f) * (0.5 + f);
    }
    [[nodiscard]] double slope(int i) const {
      return i == 0 ? f - 0.5 : (i == 1 ? -2 * f : f + 0.5);
    }
    double f = 0;
    int first = 0;
    double value[3] = {};
  };

  [[nodiscard]] double refined(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                               double start, double gap) const;

  cv::Mat1d values_;  // control points; empty: flat
  double top_ = 0;
  double steepest_ = 0;
};

}  // namespace tarsier::synth
