// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/matx.hpp>

#include <utility>
#include <vector>

namespace tarsier::sfm {

// Colour offsets g that remove seams (Lempitsky and Ivanov, "Seamless mosaicing of image-based
// texture maps", CVPR 2007; Waechter, Moehrle and Goesele, "Let there be color!", ECCV 2014). A
// vertex with several views has a node for each. The offsets minimise
//
//   sum over seams (f_a + g_a - f_b - g_b)^2
//   + `smoothness` sum over edges (g_a - g_b)^2 + 1e-4 sum g^2
//
// by conjugate gradients, for each of the three channels. The last term preserves the mean.
struct SeamProblem {
  int nodes = 0;
  std::vector<std::pair<int, int>> edges;  // between nodes of the same view
  struct Seam {
    int a = 0;
    int b = 0;
    cv::Vec3f step;  // f_b - f_a, the target for g_a - g_b
  };
  std::vector<Seam> seams;  // between nodes of the same vertex
  double smoothness = 10;
};
// One offset per node. Does not depend on the number of threads.
[[nodiscard]] std::vector<cv::Vec3f> level_seams(const SeamProblem& problem);

}  // namespace tarsier::sfm
