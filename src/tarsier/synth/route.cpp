// SPDX-License-Identifier: MIT
#include "tarsier/synth/route.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace tarsier::synth {

using Eigen::Vector2d;

Route::Route(std::span<const Vector2d> line, double place_smoothing, double direction_smoothing)
    : line_(line.begin(), line.end()),
      lengths_{0},
      place_smoothing_(place_smoothing),
      direction_smoothing_(direction_smoothing) {
  for (std::size_t k = 1; k < line_.size(); ++k)
    lengths_.push_back(lengths_.back() + (line_[k] - line_[k - 1]).norm());
}

Vector2d Route::on_line(double position) const {
  const double s = std::clamp(position, 0.0, length());
  const auto k = static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(
      std::upper_bound(lengths_.begin(), lengths_.end(), s) - lengths_.begin() - 1, 0,
      static_cast<std::ptrdiff_t>(line_.size()) - 2));
  return line_[k] + (s - lengths_[k]) / (lengths_[k + 1] - lengths_[k]) * (line_[k + 1] - line_[k]);
}

Vector2d Route::at(double position) const {
  return (on_line(position - place_smoothing_) + on_line(position) +
          on_line(position + place_smoothing_)) /
         3;
}

Vector2d Route::ahead(double position) const {
  return (on_line(position + direction_smoothing_) - on_line(position - direction_smoothing_))
      .normalized();
}

std::vector<double> Route::positions(int count, double turn_length) const {
  // Sum of length and rotation, at samples of the line.
  constexpr double kSample = 0.25;
  const auto samples = static_cast<std::size_t>(std::ceil(length() / kSample));
  const double step = length() / static_cast<double>(samples);
  std::vector<double> effort{0};
  for (std::size_t k = 1; k <= samples; ++k) {
    const double s = length() * static_cast<double>(k) / static_cast<double>(samples);
    const double turn = std::acos(std::clamp(ahead(s).dot(ahead(s - step)), -1.0, 1.0));
    effort.push_back(effort.back() + step + turn_length * turn);
  }
  std::vector<double> positions;
  for (int i = 0; i < count; ++i) {
    const double wanted = effort.back() * i / std::max(1, count - 1);
    const auto k = static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(
        std::upper_bound(effort.begin(), effort.end(), wanted) - effort.begin() - 1, 0,
        static_cast<std::ptrdiff_t>(samples) - 1));
    const double part = (wanted - effort[k]) / (effort[k + 1] - effort[k]);
    positions.push_back(length() * (static_cast<double>(k) + part) / static_cast<double>(samples));
  }
  return positions;
}

}  // namespace tarsier::synth
