// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/geometry/camera.h"
#include "tarsier/planar/calibration/detect.h"

#include <opencv2/core/mat.hpp>

#include <array>
#include <string>
#include <vector>

namespace tarsier::planar::calibration {

inline constexpr int kCoverageColumns = 8;
inline constexpr int kCoverageRows = 6;

// Which way a board was tilted by more than 12 degrees: the edge that came nearer.
enum class Tilt { kLeftNear, kRightNear, kTopNear, kBottomNear };

// Where in the image, and how tilted, the board was seen.
struct Coverage {
  cv::Size size;                                              // px, of the images
  std::array<int, kCoverageColumns * kCoverageRows> cells{};  // views that touch a cell, row by row
  std::array<int, 4> tilts{};                                 // views, by Tilt
  int views = 0;

  [[nodiscard]] double share() const;  // of cells that a view touches, 0..1
  // What more views should show, in words, most useful first: "the top left of the image", "the
  // board's left edge nearer". Empty: enough (every ninth of the image at least half covered, all
  // four tilts, 8 views).
  [[nodiscard]] std::vector<std::string> missing() const;
  // How much that is new a further view brings, 0..1: new cells and tilts.
  [[nodiscard]] double gain(const BoardView& view, const BoardSpec& spec) const;
  void add(const BoardView& view, const BoardSpec& spec);
};

// Of all views that are not empty. Tilts are judged with a guessed focal length (1.1 x the larger
// side), which is near enough for a direction.
[[nodiscard]] Coverage coverage_of(const std::vector<BoardView>& views, const BoardSpec& spec,
                                   cv::Size size);

// Mean distance (px) of the points that two views share; infinite where these are fewer than half.
[[nodiscard]] double view_distance(const BoardView& a, const BoardView& b);

// The angles (degrees) by which a view's board is turned about the image's vertical (+: right
// edge nearer) and horizontal direction (+: bottom edge nearer); {0, 0} where no pose is found.
[[nodiscard]] cv::Point2d tilt_of(const BoardView& view, const BoardSpec& spec, cv::Size size);

}  // namespace tarsier::planar::calibration
