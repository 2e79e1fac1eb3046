// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/sfm/global/view_graph.h"

#include <Eigen/Core>

#include <stop_token>
#include <vector>

namespace tarsier::sfm {

struct RotationAveragingOptions {
  int l1_iterations = 10;       // of the first part, for the sum of absolute angles
  int max_iterations = 100;     // of the second part, for the robust loss
  double sigma_deg = 5;         // edges with a larger error get little weight
  double tolerance_deg = 1e-3;  // stops when no rotation changes by more

  [[nodiscard]] OptionFields fields() {
    return {{"l1_iterations", l1_iterations, range(0, 1000)},
            {"max_iterations", max_iterations, range(0, 1000)},
            {"sigma_deg", sigma_deg, range(0.01, 90)},
            {"tolerance_deg", tolerance_deg, range(1e-9, 10)}};
  }
  void check() const { check_fields(*this); }
};

struct AveragedRotations {
  // camera_from_world of each node; that of the first node is the identity
  std::vector<Eigen::Matrix3d> rotations;
  std::vector<double> errors_deg;  // for each edge: angle between its rotation and the result
  int iterations = 0;
};

// Computes the rotations R_i that agree best with the edges, R_ij ~ R_j R_i'. They minimise the
// robust sum of the edges' angular errors
//
//   sum w_ij rho(|log(R_j' R_ij R_i)|)
//
// by linear least-squares steps R_i <- R_i exp(w_i). All three coordinates share one sparse
// Laplacian. The start is the spanning tree of maximum weight. Reweighted steps for the sum of
// absolute angles follow, which bad edges hardly influence. The last steps use the loss of Geman
// and McClure (Chatterjee and Govindu, Robust relative rotation averaging, PAMI 2018). An edge of
// weight w counts w / (w + 50). Uses one thread and no random numbers. Throws std::invalid_argument
// for a graph that is not connected or has no edges, Interrupted.
[[nodiscard]] AveragedRotations average_rotations(int nodes,
                                                  const std::vector<RelativeRotation>& edges,
                                                  const RotationAveragingOptions& options = {},
                                                  const std::stop_token& stop = {});

}  // namespace tarsier::sfm
