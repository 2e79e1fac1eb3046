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

// Direction of a board's tilt of more than 12 degrees: the edge that is nearer.
enum class Tilt { kLeftNear, kRightNear, kTopNear, kBottomNear };

// The image regions and tilts in which the board was seen.
struct Coverage {
  cv::Size size;  // px, of the images
  // Number of views that touch a cell, row by row.
  std::array<int, kCoverageColumns * kCoverageRows> cells{};
  std::array<int, 4> tilts{};  // number of views, indexed by Tilt
  int views = 0;

  [[nodiscard]] double share() const;  // share of cells that a view touches, 0..1
  // What further views should show, in words, most useful first: "the top left of the image", "the
  // board, left edge closer". Empty if the coverage is sufficient: every ninth of the image at
  // least half covered, all four tilts, 8 views.
  [[nodiscard]] std::vector<std::string> missing() const;
  // Share of new cells and tilts in a further view, 0..1.
  [[nodiscard]] double gain(const BoardView& view, const BoardSpec& spec) const;
  void add(const BoardView& view, const BoardSpec& spec);
};

// Coverage of all non-empty views. Tilts use a guessed focal length (1.1 x the larger side), which
// is accurate enough for a direction.
[[nodiscard]] Coverage coverage_of(const std::vector<BoardView>& views, const BoardSpec& spec,
                                   cv::Size size);

// Mean distance (px) of the points common to two views; infinite if fewer than half are common.
[[nodiscard]] double view_distance(const BoardView& a, const BoardView& b);

// The rotation (degrees) of a view's board about the image's vertical axis (+: right edge nearer)
// and horizontal axis (+: bottom edge nearer). {0, 0} if no pose is found.
[[nodiscard]] cv::Point2d tilt_of(const BoardView& view, const BoardSpec& spec, cv::Size size);

}  // namespace tarsier::planar::calibration
