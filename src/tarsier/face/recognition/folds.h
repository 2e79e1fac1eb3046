// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/recognition/recognizer.h"

#include <Eigen/Core>

#include <stop_token>
#include <vector>

// Estimates the scores of a recogniser for held-out images and people from its training faces.
namespace tarsier::face::recognition {

// Cross-validation of the recognisers with a subspace. People and images are held out in turn;
// mean, principal components, and whitening or discriminants are learned without them.
struct CrossValidation {
  Algorithm algorithm = Algorithm::kDefault;
  // (faces * copies) x c, the copies of a face in adjacent rows. Coordinates in the principal
  // components of all basis rows, including held-out ones, so that strangers lose nothing by this
  // projection.
  Eigen::MatrixXd coefficients;
  std::vector<int> people;  // of each face
  int person_count = 0;
  int copies = 1;
  std::vector<std::size_t> basis;  // rows from which the principal components are computed
  int max_components = 0;          // max number of components; 0: all
  double ridge = 0;                // default
  double mean_weight = 0;
  Eigen::RowVectorXd background;  // mean of people in general, as coefficients; or empty
  double background_weight = 0;   // its weight, in people
  // c x c, the background's scatter within people; or empty. It is added to the scatter of the
  // faces. The principal components are then not recomputed for fewer faces.
  Eigen::MatrixXd prior_within;
  double prior_within_weight = 0;  // its weight, in differences between images
  // For each face, the squared length of the part outside the coefficients. Empty: there is no such
  // part.
  Eigen::VectorXd residual_squared;

  // m x m for the first m coefficients, learned from all faces that are not marked (empty: from
  // all).
  [[nodiscard]] Whitening whitener(const Eigen::MatrixXd& some,
                                   const std::vector<bool>& held_out) const;
  // Templates of all faces, learned without the marked ones; default: scaled.
  [[nodiscard]] Rows templates(const std::vector<bool>& held_out) const;
  // Number of folds. score() adds the scores of one fold to `sample` (its `gallery` starts at 0).
  [[nodiscard]] int count() const;
  void score(int fold, ScoreSample& sample) const;
  // All folds. Throws Interrupted.
  [[nodiscard]] ScoreSample scores(const std::stop_token& stop) const;
};

// For LBPH, which needs no training: compares each image with those of all other people (as a
// stranger) and with the other images of the same person (genuine). Also used for the other
// recognisers if there are too many faces for folds; the scores are then optimistic. Throws
// Interrupted.
[[nodiscard]] ScoreSample leave_one_out_scores(const Recognizer& model,
                                               const std::stop_token& stop);

}  // namespace tarsier::face::recognition
