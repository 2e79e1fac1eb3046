// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/matx.hpp>

#include <utility>
#include <vector>

namespace tarsier::sfm {

// Offsets g of colours that make seams disappear (Lempitsky and Ivanov, "Seamless mosaicing of
// image-based texture maps", CVPR 2007; Waechter, Moehrle and Goesele, "Let there be color!", ECCV
// 2014): of a vertex that several views paint there is a node for each, and
//
//   sum over seams (f_a + g_a - f_b - g_b)^2 + `smoothness` sum over edges (g_a - g_b)^2 + 1e-4 sum g^2
//
// is least: by conjugate gradients, each of the three channels. The last term keeps the mean.
struct SeamProblem {
  int nodes = 0;
  std::vector<std::pair<int, int>> edges;  // between nodes that one view paints
  struct Seam {
    int a = 0;
    int b = 0;
    cv::Vec3f step;  // f_b - f_a, what g_a - g_b should be
  };
  std::vector<Seam> seams;  // between nodes of one vertex
  double smoothness = 10;
};
// Of each node. The same for any number of threads.
[[nodiscard]] std::vector<cv::Vec3f> level_seams(const SeamProblem& problem);

}  // namespace tarsier::sfm
