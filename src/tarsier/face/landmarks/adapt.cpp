// SPDX-License-Identifier: MIT
#include "tarsier/face/landmarks/adapt.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/require.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/regression/starts.h"

#include <fmt/format.h>
#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace tarsier::face::landmarks {

namespace {

constexpr int kMinFacesForChoice = 3;  // images
constexpr int kMaxFolds = 5;
constexpr int kMaxStarts = 1500;  // for all images together: the size of the dual problem
constexpr int kChoiceStarts = 5;
constexpr std::uint64_t kTestSeed = 0x7e57;

void adapt_parts(LandmarkModel& model, const LandmarkModel& base,
                 const std::vector<regression::TrainingFace>& faces, const AdaptOptions& options,
                 double ridge, const std::stop_token& stop) {
  const int each = std::clamp(kMaxStarts / static_cast<int>(faces.size()), 1, options.starts);
  const std::vector<regression::Start> starts =
      regression::scattered_starts(faces, base.shape.mean, each, options.seed);
  if (base.trees) model.trees = adapt_trees(*base.trees, faces, starts, ridge, stop);
  if (base.descent) model.descent = adapt_descent(*base.descent, faces, starts, ridge, stop);
  if (base.network) model.network = adapt_network(*base.network, faces, starts, ridge, stop);
}

// Mean over the faces, in sizes of the shape.
double error_of(const LandmarkModel& model, const std::vector<regression::TrainingFace>& faces,
                std::uint64_t seed, const std::stop_token& stop) {
  const std::vector<regression::Start> starts =
      regression::scattered_starts(faces, model.shape.mean, kChoiceStarts, seed ^ kTestSeed);
  std::vector<double> errors(starts.size());
  const FitOptions options;
  cv::parallel_for_(cv::Range(0, static_cast<int>(starts.size())), [&](const cv::Range& range) {
    FitWorkspace workspace;
    for (int i = range.start; i < range.end && !stop.stop_requested(); ++i) {
      const auto index = static_cast<std::size_t>(i);
      const regression::TrainingFace& face = faces[static_cast<std::size_t>(starts[index].face)];
      const Fit fit = fit_points(model, options, face.gray, starts[index].points, workspace);
      errors[index] =
          (fit.points - face.points).colwise().norm().mean() / regression::shape_size(face.points);
    }
  });
  throw_if_stopped(stop);
  return std::accumulate(errors.begin(), errors.end(), 0.0) / static_cast<double>(errors.size());
}

// Errors on held-out images: of the base, then of each choice.
std::vector<double> cross_validation_errors(const LandmarkModel& base,
                                            const std::vector<regression::TrainingFace>& faces,
                                            const AdaptOptions& options,
                                            const std::vector<double>& choices, Progress& progress,
                                            const std::stop_token& stop) {
  const int folds = std::min(kMaxFolds, static_cast<int>(faces.size()));
  std::vector<double> errors(choices.size() + 1, 0);
  progress.begin("leaving out",
                 static_cast<std::int64_t>(folds) * static_cast<std::int64_t>(choices.size()),
                 "models");
  LandmarkModel model = base;
  model.quality.reset();
  model.visibility.reset();
  for (int fold = 0; fold < folds; ++fold) {
    std::vector<regression::TrainingFace> training;
    std::vector<regression::TrainingFace> held_out;
    for (std::size_t f = 0; f < faces.size(); ++f) {
      (static_cast<int>(f) % folds == fold ? held_out : training).push_back(faces[f]);
    }
    const double share = static_cast<double>(held_out.size()) / static_cast<double>(faces.size());
    model.trees = base.trees;
    model.descent = base.descent;
    model.network = base.network;
    errors[0] += share * error_of(model, held_out, options.seed, stop);
    for (std::size_t c = 0; c < choices.size(); ++c) {
      adapt_parts(model, base, training, options, choices[c], stop);
      errors[c + 1] += share * error_of(model, held_out, options.seed, stop);
      progress.advance();
    }
  }
  progress.end();
  return errors;
}

}  // namespace

void AdaptOptions::check() const {
  check_fields(*this);
  TARSIER_REQUIRE(!choices.empty(), "no ridges to choose from");
}

AdaptedModel adapt_landmark_model(const LandmarkModel& base, const shape::LandmarkSet& set,
                                  const std::string& set_path, const AdaptOptions& options,
                                  Progress& progress, const std::stop_token& stop) {
  options.check();
  base.check();
  TARSIER_REQUIRE(base.trees || base.descent, "a model with neither trees nor sdm");
  if (!set.samples.empty() && set.points() != base.points()) {
    throw InputError(set_path.empty() ? "the set" : set_path,
                     fmt::format("has {} points, the model {}", set.points(), base.points()));
  }
  AdaptedModel result;
  const std::vector<regression::TrainingFace> faces =
      regression::load_training_faces(set, set_path, {}, progress, stop, result.skipped);
  result.model = base;
  result.faces = static_cast<int>(faces.size());
  result.ridge = options.ridge.value_or(options.default_ridge);
  if (result.faces >= kMinFacesForChoice) {
    result.ridge_chosen = !options.ridge;
    const std::vector<double> choices =
        options.ridge ? std::vector<double>{*options.ridge} : options.choices;
    const std::vector<double> errors =
        cross_validation_errors(base, faces, options, choices, progress, stop);
    const auto best = std::min_element(errors.begin() + 1, errors.end());
    result.base_error = errors[0];
    result.adapted_error = *best;
    result.ridge = choices[static_cast<std::size_t>(best - errors.begin() - 1)];
    if (result.ridge_chosen && result.adapted_error >= result.base_error) {
      result.base_kept = true;
      return result;
    }
  }
  progress.begin("adapting", 1, "models");
  adapt_parts(result.model, base, faces, options, result.ridge, stop);
  progress.end();
  return result;
}

}  // namespace tarsier::face::landmarks
