// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/recognition/recognizer.h"

#include <Eigen/Core>

#include <stop_token>
#include <vector>

// Scores that a recogniser would give to images and people it was not trained on, from its
// training faces.
namespace tarsier::face::recognition {

// Of the recognisers with a subspace: people and images are left out in turn, and all that is
// learned (mean, principal components, whitening or discriminants) is learned without them.
struct Folds {
  Algorithm algorithm = Algorithm::kDefault;
  // (faces * moves) x c, the moves of a face together: in the principal components of all basis
  // rows, none left out, so that nothing that a stranger might lose is lost already.
  Eigen::MatrixXd coefficients;
  std::vector<int> people;  // of each face
  int person_count = 0;
  int moves = 1;
  std::vector<std::size_t> basis;  // rows that the principal components are made of
  int most = 0;                    // components, at most; 0: all
  double ridge = 0;                // default
  double mean_weight = 0;
  Eigen::RowVectorXd background;  // the mean of people in general, in the coefficients; or empty
  double background_weight = 0;   // people that it counts for
  // c x c, what a background knows of the scatter within people: added to that of the faces, in
  // place of principal components of fewer faces. Or empty.
  Eigen::MatrixXd known_within;
  double known_weight = 0;  // differences that it counts for
  // Of each face, the squared length of what the coefficients do not hold. Or empty: they hold all.
  Eigen::VectorXd outside;

  // m x m for the first m coefficients, learned from all faces but those marked (empty: from all).
  [[nodiscard]] Whitening whitener(const Eigen::MatrixXd& some,
                                   const std::vector<bool>& left_out) const;
  // Templates of all faces, from what is learned without those marked; default: scaled.
  [[nodiscard]] Rows templates(const std::vector<bool>& left_out) const;
  // How many times people and images are left out; adds the scores of the k-th time to `sample`
  // (its `gallery` starts at 0).
  [[nodiscard]] int count() const;
  void score(int fold, ScoreSample& sample) const;
  // Of all times. Throws Interrupted.
  [[nodiscard]] ScoreSample scores(const std::stop_token& stop) const;
};

// Of LBPH, which learns nothing: each image against those of everybody else (a stranger), and
// against the other images of the same person (genuine). For the others where there are too many
// faces for folds; then they look better than they are. Throws Interrupted.
[[nodiscard]] ScoreSample left_out_scores(const Recognizer& model, const std::stop_token& stop);

}  // namespace tarsier::face::recognition
