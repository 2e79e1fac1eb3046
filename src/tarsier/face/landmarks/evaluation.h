// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>

#include <array>
#include <optional>
#include <string>
#include <vector>

// Accuracy of fitted points. NME: mean distance of the points from the ground truth, % of the
// distance of two points (outer eye corners).
namespace tarsier::face::landmarks {

struct FitOutcome {
  std::string image;
  std::string person;
  double nme = 0;       // %, if the right face was found
  bool missed = false;  // no face found
  bool wrong = false;   // another face: its centre is off by more than one eye distance
  double dx = 0;        // mean error, % of the eye distance
  double dy = 0;
  double ms = 0;
};

struct LandmarkScore {
  int faces = 0;
  int missed = 0;
  int wrong = 0;
  double mean = 0;  // NME, %, over the faces that were found correctly; 0 if there are none
  double median = 0;
  double p90 = 0;
  double failures = 0;  // share of all faces with NME above 8 %, missed or wrong
  double auc = 0;       // area under the cumulative curve up to 8 %, 0..1, over all faces
  double dx = 0;        // mean of the means, %
  double dy = 0;
};

// Whether the errors of a sample can be normalised: its two eyes do not coincide.
[[nodiscard]] bool has_eye_distance(const Eigen::Matrix2Xd& truth, const std::array<int, 2>& eyes);
// Compares fitted points (empty: no face found) with the ground truth (2 x n each, px). Throws
// std::invalid_argument for different sizes or coinciding eyes.
[[nodiscard]] FitOutcome evaluate_fit(const std::optional<Eigen::Matrix2Xd>& fitted,
                                      const Eigen::Matrix2Xd& truth,
                                      const std::array<int, 2>& eyes);

[[nodiscard]] LandmarkScore score_of(const std::vector<FitOutcome>& outcomes);

// Share of all faces whose NME is at most each of `errors` (%): the cumulative error curve.
[[nodiscard]] std::vector<double> cumulative(const std::vector<FitOutcome>& outcomes,
                                             const std::vector<double>& errors);

}  // namespace tarsier::face::landmarks
