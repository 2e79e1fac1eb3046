// SPDX-License-Identifier: MIT
#include "tarsier/synth/height_field.h"

#include <algorithm>
#include <cmath>

namespace tarsier::synth {

HeightField::HeightField(const Rng& base) : values_(kRows, kCols, 0.0) {
  std::uint64_t stream = 0;
  double amplitude = 1;
  for (const int step : {32, 16, 8, 4}) {  // control points per cell: 6.4 to 0.8 units
    Rng rng = base.fork(++stream);
    cv::Mat1d grid(kRows / step, kCols / step);
    for (double& value : grid) value = rng.uniform(-1, 1);
    for (int y = 0; y < kRows; ++y) {
      for (int x = 0; x < kCols; ++x) {
        const auto ramp = [step](int at) {
          const double f = static_cast<double>(at % step) / step;
          return f * f * (3 - 2 * f);
        };
        const auto value = [&](int dy, int dx) {
          return grid((y / step + dy) % grid.rows, (x / step + dx) % grid.cols);
        };
        const double up = value(0, 0) + ramp(x) * (value(0, 1) - value(0, 0));
        const double low = value(1, 0) + ramp(x) * (value(1, 1) - value(1, 0));
        values_(y, x) += amplitude * (up + ramp(y) * (low - up));
      }
    }
    amplitude *= 0.5;
  }
  points_ = values_[0];
  double low = 0;
  double high = 0;
  cv::minMaxLoc(values_, &low, &high);
  for (double& value : values_) value = kReliefDepth * (value - low) / (high - low);
  top_ = kReliefDepth;
  // The slope of the spline along an axis is a mean of the slopes of its control points.
  double slope_x = 0;
  double slope_y = 0;
  for (int y = 0; y < kRows; ++y) {
    for (int x = 0; x < kCols; ++x) {
      const double here = values_(y, x);
      slope_x = std::max(slope_x, std::abs(values_(y, (x + 1) % kCols) - here));
      slope_y = std::max(slope_y, std::abs(values_((y + 1) % kRows, x) - here));
    }
  }
  max_slope_ = std::hypot(slope_x, slope_y) / kSpacing;
}

double HeightField::first_hit(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                              double limit, double from) const {
  if (direction[2] >= 0) return limit;
  double t = (top_ - origin[2]) / direction[2];
  if (is_flat()) return std::min(t, limit);
  t = std::max(t, from);
  // A surface of this slope cannot be met before this share of the gap.
  const double pace = 1 / (-direction[2] + max_slope_ * std::sqrt(direction[0] * direction[0] +
                                                                  direction[1] * direction[1]));
  const auto gap_at = [&](double at) {
    return origin[2] + at * direction[2] -
           height(origin[0] + at * direction[0], origin[1] + at * direction[1]);
  };
  constexpr double kNear = 0.02;
  constexpr double kExact = 1e-9;
  double gap = gap_at(t);
  for (int i = 0; i < 2000 && gap > kExact; ++i) {
    if (t >= limit) return limit;
    if (gap < kNear) {
      const double exact = refined(origin, direction, t);
      if (exact >= 0) return std::min(exact, limit);
    }
    t += gap * pace;
    gap = gap_at(t);
  }
  return std::min(t, limit);
}

double HeightField::free_distance(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                                  double spread, double from) const {
  if (is_flat() || direction[2] + spread >= 0) return from;
  // Nothing can be met before the steepest ray reaches the highest point.
  double t = std::max(from, (top_ - origin[2]) / (direction[2] - spread));
  // At t, a ray of the cone is at most t * spread off its axis. The free distance is smaller by
  // this, measured perpendicular to the steepest slope.
  const double widening = spread * std::sqrt(1 + max_slope_ * max_slope_);
  const double pace =
      1 / (-direction[2] +
           max_slope_ * std::sqrt(direction[0] * direction[0] + direction[1] * direction[1]) +
           widening);
  constexpr double kCloseEnough = 0.6;
  for (int i = 0; i < 100; ++i) {
    const double gap = origin[2] + t * direction[2] -
                       height(origin[0] + t * direction[0], origin[1] + t * direction[1]) -
                       t * widening;
    if (gap < kCloseEnough * t * widening) break;  // smaller steps gain little
    t += gap * pace;
  }
  return t;
}

// Newton's steps from just above the surface; negative if they diverge, as for a ray that only
// grazes the surface.
double HeightField::refined(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                            double start) const {
  double t = start;
  for (int i = 0; i < 7; ++i) {
    const Shape at = shape(origin[0] + t * direction[0], origin[1] + t * direction[1]);
    const double gap = origin[2] + t * direction[2] - at.height;
    if (std::abs(gap) < 1e-9) return t;
    const double closing = at.slope[0] * direction[0] + at.slope[1] * direction[1] - direction[2];
    if (closing < 0.15) return -1;
    t += gap / closing;
    if (t < start || t > start + 0.15) return -1;
  }
  return -1;
}

}  // namespace tarsier::synth
