// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/rng.h"
#include "tarsier/synth/sfm_scene_texture.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

// The surface of sfm_scene.h.
namespace tarsier::synth {

constexpr double kReliefDepth = 2;  // units

// z over (x, y): a quadratic B-spline, so height and slope are exact and smooth.
class HeightField {
 public:
  HeightField() = default;  // flat

  explicit HeightField(const Rng& base);

  [[nodiscard]] bool is_flat() const { return points_ == nullptr; }

  [[nodiscard]] double height(double x, double y) const {
    if (is_flat()) return 0;
    const Weights u(x);
    const Weights v(y);
    double sum = 0;
    for (int j = 0; j < 3; ++j) {
      const double* row = points_ + ((v.first + j) & (kRows - 1)) * kCols;
      double line = 0;
      for (int i = 0; i < 3; ++i) line += u.value[i] * row[(u.first + i) & (kCols - 1)];
      sum += v.value[j] * line;
    }
    return sum;
  }

  [[nodiscard]] cv::Vec2d slope(double x, double y) const { return shape(x, y).slope; }

  // The first t < limit at which origin + t * direction meets the surface from above; `limit` if
  // there is none. The ray must be free up to `from`, where the search starts.
  [[nodiscard]] double first_hit(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                 double limit, double from = 0) const;

  // Returns t >= from such that all rays of a cone are free of the surface up to t, if they are
  // free up to `from`. The rays start at `origin`; their directions differ from `direction` by at
  // most `spread`. After J. Amanatides, "Ray tracing with cones", SIGGRAPH 1984.
  [[nodiscard]] double free_distance(const Eigen::Vector3d& origin,
                                     const Eigen::Vector3d& direction, double spread,
                                     double from) const;

 private:
  static constexpr int kCols = 256;  // powers of 2
  static constexpr int kRows = 128;
  static constexpr double kSpacing = 0.2;

  struct Weights {
    explicit Weights(double x) {
      const double u = x * (1 / kSpacing);
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

  struct Shape {
    double height = 0;
    cv::Vec2d slope{0, 0};
  };
  [[nodiscard]] Shape shape(double x, double y) const {
    if (is_flat()) return {};
    const Weights u(x);
    const Weights v(y);
    double height = 0;
    double along_x = 0;
    double along_y = 0;
    for (int j = 0; j < 3; ++j) {
      const double* row = points_ + ((v.first + j) & (kRows - 1)) * kCols;
      double line = 0;
      double line_slope = 0;
      for (int i = 0; i < 3; ++i) {
        const double value = row[(u.first + i) & (kCols - 1)];
        line += u.value[i] * value;
        line_slope += u.slope(i) * value;
      }
      height += v.value[j] * line;
      along_x += v.value[j] * line_slope;
      along_y += v.slope(j) * line;
    }
    return {height, {along_x / kSpacing, along_y / kSpacing}};
  }

  [[nodiscard]] double refined(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                               double start) const;

  cv::Mat1d values_;                // control points; empty: flat
  const double* points_ = nullptr;  // data of values_, without a call
  double top_ = 0;
  double max_slope_ = 0;
};

}  // namespace tarsier::synth
