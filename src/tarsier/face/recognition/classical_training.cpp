// SPDX-License-Identifier: MIT
#include "tarsier/face/recognition/classical_training.h"

#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/recognition/folds.h"
#include "tarsier/face/recognition/subspace.h"

#include <stdexcept>
#include <utility>

namespace tarsier::face::recognition {
namespace {

// With more faces than this, folds take too long.
constexpr std::size_t kMaxFoldFaces = 480;

// Eigenfaces and Fisherfaces: their distances have no fixed scale, so there is no prior.
void calibrate_pixels(Recognizer& model, const Rows& rows, const std::stop_token& stop) {
  if (model.labels.size() < 2) return;
  ScoreSample sample;
  if (model.people.size() <= kMaxFoldFaces) {
    const Pca pca = principal_components(rows);
    CrossValidation validation;
    validation.algorithm = model.options.algorithm;
    validation.coefficients = products(rows.rowwise() - pca.mean, pca.components).cast<double>();
    validation.people = model.people;
    validation.person_count = static_cast<int>(model.labels.size());
    for (std::size_t i = 0; i < model.people.size(); ++i) validation.basis.push_back(i);
    validation.max_components = model.options.components;
    sample = validation.scores(stop);
  } else {
    sample = leave_one_out_scores(model, stop);
  }
  if (!sample.impostor.empty()) model.calibration = fit_calibration(sample, {0, 1, 0, 0});
}

void train_fisher(Recognizer& model, const Rows& rows) {
  const int people = static_cast<int>(model.labels.size());
  const auto faces = static_cast<int>(rows.rows());
  if (people < 2) {
    throw std::invalid_argument("Fisherfaces needs faces of at least two people, there is one");
  }
  if (faces <= people)
    throw std::invalid_argument("Fisherfaces needs more than one image of somebody");
  const Pca pca = principal_components(rows, faces - people);
  TARSIER_REQUIRE(pca.components.rows() > 0, "the faces are flat or all the same");
  const Eigen::MatrixXd coefficients =
      products(rows.rowwise() - pca.mean, pca.components).cast<double>();
  Eigen::MatrixXd directions =
      linear_discriminants(coefficients, model.people, people, &model.eigenvalues);
  if (model.options.components > 0 && directions.cols() > model.options.components) {
    directions = directions.leftCols(model.options.components).eval();
    model.eigenvalues = model.eigenvalues.head(model.options.components).eval();
  }
  model.mean = pca.mean;
  model.components = (directions.transpose() * pca.components.cast<double>()).cast<float>();
}

}  // namespace

void train_classical(Recognizer& model, const Rows& rows, const std::stop_token& stop) {
  const RecognizerOptions& options = model.options;
  switch (options.algorithm) {
    case Algorithm::kEigen: {
      Pca pca = principal_components(rows, options.components);
      if (pca.components.rows() == 0) {  // one image: its distance to the mean is zero
        throw std::invalid_argument("Eigenfaces needs two different images");
      }
      model.mean = pca.mean;
      model.components = std::move(pca.components);
      model.eigenvalues = std::move(pca.variance);
      break;
    }
    case Algorithm::kFisher:
      train_fisher(model, rows);
      break;
    default:
      model.templates = rows;
      break;
  }
  throw_if_stopped(stop);
  if (options.algorithm != Algorithm::kLbph) {
    model.templates = products(rows.rowwise() - model.mean, model.components);
    calibrate_pixels(model, rows, stop);
  } else if (model.labels.size() > 1) {
    model.calibration = fit_calibration(leave_one_out_scores(model, stop), {0, 1, 0, 0});
  }
}

}  // namespace tarsier::face::recognition
