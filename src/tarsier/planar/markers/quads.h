// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/planar/markers/outlines.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <array>
#include <vector>

// Dark convex quadrilaterals in an image: where markers may be.
namespace tarsier::planar::markers {

using Quad = std::array<Eigen::Vector2d, 4>;  // px, clockwise as seen (x right, y down)

struct QuadOptions {
  double min_side_px = 9;  // of the shortest side
  // Grey levels that black and white differ by at least, see OutlineOptions.
  int min_contrast = 20;
  // How often the image is halved, each size searched too: a blurred or noisy edge is a clear one
  // in a smaller image.
  int halvings = 1;
  double straight = 0.035;  // how far a contour may leave the quadrilateral, share of its length

  [[nodiscard]] OptionFields fields() {
    return {{"min_side_px", min_side_px, range(4, 1000), "--min-side",
             "px, of the shortest side of a marker"},
            {"min_contrast", min_contrast, range(2, 255)},
            {"halvings", halvings, range(0, 6)},
            {"straight", straight, inside(0, 0.5)}};
  }
  void check() const { check_fields(*this); }
};

// Buffers that a video reuses.
struct QuadWorkspace {
  cv::Mat half;
  cv::Mat other_half;
  OutlineWorkspace outlines;
};

// Candidates in `gray` (CV_8UC1), each place once, with corners good to about half a pixel:
// intersections of the straight lines through the contour's four sides. `debug` gets what is dark,
// at each size.
[[nodiscard]] std::vector<Quad> find_quads(const cv::Mat& gray, const QuadOptions& options,
                                           QuadWorkspace& workspace, DebugSink* debug = nullptr);

// The corners after their sides have been fitted to the image's edges: along normals of each side
// the place where brightness changes, found from the gradient's centroid within +-`reach` px, then
// a line by robust least squares, sides that bend are refused (nothing). `dark_inside`: only edges
// from dark (inside) to bright (outside) count.
struct RefineOptions {
  double reach_px = 3;  // largest distance that an edge may be off
  int samples = 64;     // on each side at most

  [[nodiscard]] OptionFields fields() {
    return {{"reach_px", reach_px, above(0, 50)}, {"samples", samples, range(4, 1000)}};
  }
  void check() const { check_fields(*this); }
};
[[nodiscard]] bool refine_quad(const cv::Mat& gray, const RefineOptions& options, Quad& quad);

}  // namespace tarsier::planar::markers
