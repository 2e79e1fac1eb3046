// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/marker/dictionary.h"
#include "tarsier/marker/quads.h"

#include <opencv2/core/mat.hpp>

#include <optional>
#include <vector>

namespace tarsier::marker {

// From cells of the marker (0..n+2 in both directions, the black frame is one cell wide) to the
// picture: the homography of the four corners. Throws std::invalid_argument for corners that have
// none.
[[nodiscard]] Eigen::Matrix3d picture_from_cells(const Quad& quad, int cells);

struct Reading {
  Match match;
  double contrast = 0;  // white less black, grey levels
  double margin = 0;    // how clearly cells are black or white: mean distance from the threshold as
                        // a share of the contrast's half, 0..1
};

struct DecodeOptions {
  int max_errors = -1;         // cells that may be wrong; -1: half of what the family can mend
  double min_contrast = 12;    // grey levels
  double border_errors = 0.1;  // share of the frame's cells that may be bright
  void check() const;
};

// What the cells inside a quad say. Black and white are not two numbers but two planes over the
// marker, fitted to its frame and to the paper around it, so that a shadow or a gradient of light
// across the marker does no harm (Olson, "AprilTag", ICRA 2011). Nothing where the frame is not
// black, or the cells spell no marker.
[[nodiscard]] std::optional<Reading> read_quad(const cv::Mat& gray, const Quad& quad,
                                               const Dictionary& dictionary,
                                               const DecodeOptions& options);

}  // namespace tarsier::marker
