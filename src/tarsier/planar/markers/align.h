// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/planar/markers/decode.h"
#include "tarsier/planar/markers/dictionary.h"
#include "tarsier/planar/markers/quads.h"

#include <opencv2/core/mat.hpp>

#include <array>
#include <optional>

namespace tarsier::planar::markers {

struct AlignOptions {
  int iterations = 4;    // at most
  int max_samples = 36;  // in each direction over the marker
  double margin = 0.8;   // of white paper that counts too, cells

  [[nodiscard]] OptionFields fields() {
    return {{"iterations", iterations, range(1, 100)},
            {"max_samples", max_samples, range(8, 200)},
            {"margin", margin, range(0, 1)}};
  }
  void check() const { check_fields(*this); }
};

struct Alignment {
  Quad corners;            // px, as they were given
  double correlation = 0;  // of image and marker over the cells inside the frame, -1..1
  double blur_px = 0;      // standard deviation of the blur along the sharper direction
  // How surely the corners are known: the inverse of the covariance of (x0, y0, x1, y1, ..), px^-2,
  // 8 x 8, from the noise that remains; see geometry::PlanarPoseOptions.
  std::array<double, 64> information{};
};

// Lays the marker whose cells are `seen` (as the image shows them from corner 0, not turned) onto
// the image: minimises over a homography H, blur (s_u, s_v) and light (a, b, c, d, e_k)
//   sum_i w_i (I(H x_i) - a T(x_i; s_u, s_v) - b - c u_i - d v_i - sum_k e_k S_k(x_i))^2
// by Gauss-Newton steps that are composed inversely (Baker & Matthews, "Lucas-Kanade 20 years on",
// IJCV 2004), w from Tukey's biweight. T is the marker under a Gaussian, in closed form: sums of
// products of error functions, one for each cell; S_k is what lies beyond a cell of paper on side
// k. All edges of the pattern take part, not the four sides alone, and what blur does to them where
// they are close: that is worth most for small markers. Places outside the image do not count.
// Nothing where more than a third lies outside, or a corner moves by more than about a cell.
[[nodiscard]] std::optional<Alignment> align_marker(const cv::Mat& gray, Code seen, int cells,
                                                    const Quad& start, const AlignOptions& options);

}  // namespace tarsier::planar::markers
