// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/sfm/global/view_graph.h"

#include <Eigen/Core>

#include <stop_token>
#include <vector>

namespace tarsier::sfm {

struct RotationAveragingOptions {
  int l1_iterations = 10;       // of the first part
  int max_iterations = 100;     // of the second part
  double sigma_deg = 5;         // an edge that is off by more counts little
  double tolerance_deg = 1e-3;  // ends when no rotation changes by more

  [[nodiscard]] OptionFields fields() {
    return {{"l1_iterations", l1_iterations, range(0, 1000)},
            {"max_iterations", max_iterations, range(0, 1000)},
            {"sigma_deg", sigma_deg, range(0.01, 90)},
            {"tolerance_deg", tolerance_deg, range(1e-9, 10)}};
  }
  void check() const { check_fields(*this); }
};

struct AveragedRotations {
  std::vector<Eigen::Matrix3d>
      rotations;  // camera_from_world of each node; the first one's is the identity
  std::vector<double> errors_deg;  // of each edge: angle between it and what the rotations say
  int iterations = 0;
};

// The rotations R_i that agree best with those of the edges, R_ij ~ R_j R_i': they minimise the robust sum of the
// edges' angles
//
//   sum w_ij rho(|log(R_j' R_ij R_i)|)
//
// by steps R_i <- R_i exp(w_i) of linear least squares, which are the same sparse Laplacian for all three coordinates.
// A tree of the edges of most weight is the start, then reweighted steps for the sum of absolute angles follow, which
// bad edges hardly move, then those for the loss of Geman and McClure (Chatterjee and Govindu, Robust relative rotation
// averaging, PAMI 2018). An edge of weight w counts w / (w + 50). One thread, no random numbers. Throws
// std::invalid_argument for a graph that does not hang together or has no edges, Interrupted.
[[nodiscard]] AveragedRotations average_rotations(int nodes,
                                                  const std::vector<RelativeRotation>& edges,
                                                  const RotationAveragingOptions& options = {},
                                                  const std::stop_token& stop = {});

}  // namespace tarsier::sfm
