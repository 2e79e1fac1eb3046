// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/planar/markers/outlines.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <array>
#include <vector>

// Dark convex quadrilaterals in an image: candidates for markers.
namespace tarsier::planar::markers {

using Quad = std::array<Eigen::Vector2d, 4>;  // px, clockwise in the image (x right, y down)

[[nodiscard]] inline Eigen::Vector2d center_of(const Quad& quad) {
  return (quad[0] + quad[1] + quad[2] + quad[3]) / 4;
}

struct QuadOptions {
  double min_side_px = 9;  // of the shortest side
  // Minimum difference of black and white, grey levels; see OutlineOptions.
  int min_contrast = 20;
  // Number of times the image is halved; each size is searched too. A blurred or noisy edge is
  // clear in a smaller image.
  int halvings = 1;
  // Maximum deviation of a contour from the quadrilateral, relative to its length.
  double max_deviation = 0.035;

  [[nodiscard]] OptionFields fields() {
    return {{"min_side_px", min_side_px, range(4, 1000), "--min-side",
             "px, minimum length of the shortest side of a marker"},
            {"min_contrast", min_contrast, range(2, 255)},
            {"halvings", halvings, range(0, 6)},
            {"straight", max_deviation, inside(0, 0.5)}};
  }
  void check() const { check_fields(*this); }
};

// Buffers that a video reuses.
struct QuadWorkspace {
  cv::Mat half;
  cv::Mat other_half;
  OutlineWorkspace outlines;
};

// Finds candidates in `gray` (CV_8UC1), one per place, with corners accurate to about half a pixel:
// the intersections of the lines fitted to the contour's four sides. `debug` receives the dark
// regions at each size.
[[nodiscard]] std::vector<Quad> find_quads(const cv::Mat& gray, const QuadOptions& options,
                                           QuadWorkspace& workspace, DebugSink* debug = nullptr);

// Refines the corners by fitting the sides to the edges of the image. Along normals of each side,
// the edge is the centroid of the gradient within +-`reach` px; a line is then fitted by robust
// least squares. Returns false if a side is bent. Only edges from dark (inside) to bright (outside)
// count.
struct RefineOptions {
  double reach_px = 3;  // maximum distance of an edge from the given side
  int samples = 64;     // maximum per side

  [[nodiscard]] OptionFields fields() {
    return {{"reach_px", reach_px, above(0, 50)}, {"samples", samples, range(4, 1000)}};
  }
  void check() const { check_fields(*this); }
};
[[nodiscard]] bool refine_quad(const cv::Mat& gray, const RefineOptions& options, Quad& quad);

}  // namespace tarsier::planar::markers
