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

// From cells of the marker (0..n+2 in both directions, the black frame is one cell wide) to the
// image: the homography of the four corners. Throws std::invalid_argument for corners that have
// none.
[[nodiscard]] Eigen::Matrix3d image_from_cells(const Quad& quad, int cells);

// How bright the cells inside a quad are.
struct Cells {
  int count = 0;                  // n, in each direction
  std::array<float, 64> light{};  // row by row; -1 black, 1 white, 0 between or unknown
  Code read = 0;                  // 1 where light > 0
  Code unknown = 0;               // cells outside the image
  double contrast = 0;            // white less black, grey levels
  double frame_errors = 0;        // share of the frame's cells that look bright
  double margin = 0;  // how clearly cells are black or white: mean of |light|, at most 1 each

  [[nodiscard]] std::span<const float> all() const {
    return std::span(light).first(static_cast<std::size_t>(count * count));
  }
};

struct DecodeOptions {
  int max_errors = -1;  // cells that may be wrong; -1: half of what the family can mend, and never
                        // so many that chance makes markers of anything
  double min_contrast = 8;    // grey levels
  double frame_errors = 0.1;  // share of the frame's cells that may look bright
  // How well a small marker, or one with wrong cells, must agree with the image, see
  // Alignment::correlation.
  double min_correlation = 0.8;
  // Where the cells are too blurred to be read one by one: how well the whole marker must agree
  // with the image, see Alignment::correlation; above 1: such markers are left out.
  double min_blurred_correlation = 0.9;

  [[nodiscard]] OptionFields fields() {
    return {{"max_errors", max_errors, range(-1, 32)},
            {"min_contrast", min_contrast, range(1, 255)},
            {"frame_errors", frame_errors, range_below(0, 0.5)},
            {"min_correlation", min_correlation, range(0, 1), "--min-correlation",
             "how well the image of a small marker must agree with it"},
            {"min_blurred_correlation", min_blurred_correlation, at_least(0)}};
  }
  void check() const { check_fields(*this); }
};

// Black and white are not two numbers but two planes over the marker, fitted to its frame and to
// the paper around it, so that a shadow or a gradient of light across the marker does no harm
// (Olson, "AprilTag", ICRA 2011). Nothing where the frame is not darker than the paper by
// `min_contrast`, or too much of the marker lies outside the image.
[[nodiscard]] std::optional<Cells> read_cells(const cv::Mat& gray, const Quad& quad, int cells,
                                              double min_contrast);

// The same cells with the light taken out that blur brought from their neighbours: each is moved
// away from the mean of the four beside it, `strength` times the difference.
[[nodiscard]] Cells sharpened(const Cells& cells, float strength);

}  // namespace tarsier::planar::markers
