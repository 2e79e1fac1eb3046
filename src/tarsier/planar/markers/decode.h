// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/planar/markers/dictionary.h"
#include "tarsier/planar/markers/quads.h"

#include <opencv2/core/mat.hpp>

#include <array>
#include <optional>
#include <span>

namespace tarsier::planar::markers {

// The homography of the four corners: from marker cells (0..n+2 in both directions; the black frame
// is one cell wide) to the image. Throws std::invalid_argument if the corners have no homography.
[[nodiscard]] Eigen::Matrix3d image_from_cells(const Quad& quad, int cells);

// The brightness of the cells inside a quad.
struct Cells {
  int count = 0;                  // n, in each direction
  std::array<float, 64> light{};  // row by row; -1 black, 1 white; in between or 0 if uncertain
  Code read = 0;                  // 1 where light > 0
  Code unknown = 0;               // cells outside the image
  double contrast = 0;            // difference of white and black, grey levels
  double frame_errors = 0;        // share of the frame's cells that look white
  double margin = 0;              // clarity of the cells: mean of min(|light|, 1)

  [[nodiscard]] std::span<const float> all() const {
    return std::span(light).first(static_cast<std::size_t>(count * count));
  }
};

struct DecodeOptions {
  // Maximum number of wrong cells. -1: half of what the family can correct, limited so that random
  // patterns are not accepted.
  int max_errors = -1;
  double min_contrast = 8;    // grey levels
  double frame_errors = 0.1;  // maximum share of the frame's cells that may look white
  // Minimum Alignment::correlation of a small marker, or of one with wrong cells.
  double min_correlation = 0.8;
  // Minimum Alignment::correlation if the cells are too blurred to be read one by one. Above 1,
  // such markers are not detected.
  double min_blurred_correlation = 0.9;

  [[nodiscard]] OptionFields fields() {
    return {{"max_errors", max_errors, range(-1, 32)},
            {"min_contrast", min_contrast, range(1, 255)},
            {"frame_errors", frame_errors, range_below(0, 0.5)},
            {"min_correlation", min_correlation, range(0, 1), "--min-correlation",
             "minimum correlation of the image of a small marker with its pattern"},
            {"min_blurred_correlation", min_blurred_correlation, at_least(0)}};
  }
  void check() const { check_fields(*this); }
};

// Samples the cells. Black and white are modelled as two planes over the marker, fitted to its
// frame and to the surrounding paper. A shadow or a light gradient across the marker therefore does
// no harm (Olson, "AprilTag", ICRA 2011). Returns nothing if the frame is not darker than the paper
// by `min_contrast`, or if too much of the marker lies outside the image.
[[nodiscard]] std::optional<Cells> read_cells(const cv::Mat& gray, const Quad& quad, int cells,
                                              double min_contrast);

// Sharpens the cells to undo blur: adds to each cell `strength` times its difference from the mean
// of its four neighbours.
[[nodiscard]] Cells sharpened(const Cells& cells, float strength);

}  // namespace tarsier::planar::markers
