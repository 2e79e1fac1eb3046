// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"

#include <Eigen/Core>

#include <cstdint>
#include <stop_token>
#include <string>
#include <vector>

// Accuracy and speed of POSIT, compared with OpenCV's SQPNP (Terzakis and Lourakis, ECCV 2020), on
// simulated head poses: |yaw| <= 45, |pitch| <= 30, |roll| <= 20 degrees, each uniform, focal
// length 800 px, 640 x 480, distance 450 .. 900 mm, Gaussian noise on each coordinate.
namespace tarsier::face::head {

struct PositStudyOptions {
  int poses = 2000;
  std::vector<double> noise_px = {0, 0.5, 1, 2};
  std::uint64_t seed = 1;
  int reference = 30;  // for the classic form: the nose tip of 68 points

  [[nodiscard]] OptionFields fields() {
    return {{"poses", poses, at_least(1)}, {"noise_px", noise_px, range(0, 100)}};
  }
  void check() const { check_fields(*this); }
};

struct PositStudyRow {
  std::string method;  // posit-classic, posit-homogeneous, posit-homogeneous-lm, sqpnp
  double noise_px = 0;
  double rotation_deg = 0;    // mean angle between estimated and true rotation
  double translation_mm = 0;  // mean distance between estimated and true position of the centroid
  double us = 0;              // median time of one pose
  int failures = 0;           // poses without a result; excluded from the means
};

// points: 3 x n, mm. Rows: for each noise level the four methods in the order above, on the same
// images. Throws std::invalid_argument; Interrupted.
[[nodiscard]] std::vector<PositStudyRow> run_posit_study(const Eigen::Matrix3Xd& points,
                                                         const PositStudyOptions& options = {},
                                                         const std::stop_token& stop = {});

}  // namespace tarsier::face::head
