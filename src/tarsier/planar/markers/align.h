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
  int iterations = 4;    // maximum
  int max_samples = 36;  // in each direction over the marker
  double margin = 0.8;   // width of the white paper that is used too, cells

  [[nodiscard]] OptionFields fields() {
    return {{"iterations", iterations, range(1, 100)},
            {"max_samples", max_samples, range(8, 200)},
            {"margin", margin, range(0, 1)}};
  }
  void check() const { check_fields(*this); }
};

struct Alignment {
  Quad corners;            // px, in the order of the input quad
  double correlation = 0;  // correlation of image and marker over the cells inside the frame, -1..1
  double blur_px = 0;      // standard deviation of the blur along the sharper direction
  // Certainty of the corners: the inverse of the covariance of (x0, y0, x1, y1, ..), px^-2, 8 x 8,
  // estimated from the residual noise; see geometry::PlanarPoseOptions.
  std::array<double, 64> information{};
};

// Aligns a marker with the image. `seen` are the cells as the image shows them from corner 0,
// before the rotation is undone. Minimises over a homography H, blur (s_u, s_v) and light (a, b, c,
// d, e_k)
//    sum_i w_i (I(H x_i) - a T(x_i; s_u, s_v) - b - c u_i - d v_i - sum_k e_k S_k(x_i))^2
// by inverse compositional Gauss-Newton (Baker & Matthews, "Lucas-Kanade 20 years on", IJCV 2004);
// w are weights of Tukey's biweight. T is the marker blurred by a Gaussian, in closed form: a sum
// of products of error functions, one per cell. S_k is the region beyond a margin of one cell on
// side k.
// All edges of the pattern contribute, not only the four sides, and the model includes the blur of
// close edges. This helps most for small markers. Samples outside the image are ignored. Returns
// nothing if more than a third of the samples lie outside, or if a corner moves by more than about
// one cell.
[[nodiscard]] std::optional<Alignment> align_marker(const cv::Mat& gray, Code seen, int cells,
                                                    const Quad& start, const AlignOptions& options);

}  // namespace tarsier::planar::markers
