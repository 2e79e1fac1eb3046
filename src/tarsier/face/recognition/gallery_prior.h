// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/recognition/recognizer.h"

#include <Eigen/Core>

// What a background, the statistics of faces in general, adds to a gallery of few people.
namespace tarsier::face::recognition {

// The mean that is subtracted from faces: of the gallery and the background (may be null), by their
// weights. One person gives no information on the mean of people.
[[nodiscard]] Eigen::RowVectorXf mean_with_background(const Eigen::RowVectorXf& own, int people,
                                                      const Background* background);

// Appends to the background's directions (orthonormal rows) those in which the gallery also differs
// from the mean. `centred`: rows of the gallery minus the mean.
[[nodiscard]] Rows extended_basis(const Rows& basis, const Rows& centred);

// The background's scatter within people, in its directions and `more` others.
[[nodiscard]] Eigen::MatrixXd prior_within_scatter(const Background& background, Eigen::Index more);

// Prior of the scores between different people. Simulates strangers as random deviations from the
// mean face, distributed as the background's people, and scores them against each person of the
// gallery.
[[nodiscard]] CalibrationPrior impostor_prior(const Recognizer& model,
                                              const Background& background);

}  // namespace tarsier::face::recognition
