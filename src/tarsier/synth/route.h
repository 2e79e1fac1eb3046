// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <span>
#include <vector>

namespace tarsier::synth {

// A path of cameras along a line on the ground, with smoothed corners. A position on it is the
// length of the line from its start to there. Internal to this module.
class Route {
 public:
  // Lengths before and behind a position over which its place and its direction are averaged; > 0.
  // The line has at least two different points.
  Route(std::span<const Eigen::Vector2d> line, double place_smoothing, double direction_smoothing);

  [[nodiscard]] double length() const { return lengths_.back(); }
  [[nodiscard]] Eigen::Vector2d at(double position) const;
  // Unit vector in the direction of travel.
  [[nodiscard]] Eigen::Vector2d ahead(double position) const;
  // `count` positions from the start to the end. Turning by one radian counts as much as
  // `turn_length` of the line, so that they are closer together where the line bends.
  [[nodiscard]] std::vector<double> positions(int count, double turn_length) const;

 private:
  [[nodiscard]] Eigen::Vector2d on_line(double position) const;

  std::vector<Eigen::Vector2d> line_;
  std::vector<double> lengths_;  // position of each point of the line
  double place_smoothing_;
  double direction_smoothing_;
};

}  // namespace tarsier::synth
