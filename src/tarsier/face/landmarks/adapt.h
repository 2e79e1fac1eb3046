// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/regression/descent.h"
#include "tarsier/face/regression/regression_network.h"
#include "tarsier/face/regression/training_face.h"
#include "tarsier/face/regression/trees.h"

#include <cstdint>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

// Adapts a model to one person, camera or markup with a few annotated images. Each regression is
// moved from the general one R0 (maximum a posteriori with a Gaussian prior around R0),
//   R = argmin |D - Phi R|^2 + lambda |R - R0|^2,
// where Phi are the stage's features at starts scattered around the faces (descent: its descriptors
// and a constant; trees: the leaves of the last level; network: the input of its last layer) and D
// the steps to the true points. Solved in the dual form, whose size is the number of starts. Shape
// model, patches, quality and visibility are not changed.
namespace tarsier::face::landmarks {

struct AdaptOptions {
  // lambda in units of (starts per image) x (mean squared norm of a row of Phi): 1 gives the prior
  // the weight of one image. Empty: the best of `choices` on held-out images if there are at least
  // 3 images, otherwise `default_ridge`.
  std::optional<double> ridge;
  double default_ridge = 0.3;
  std::vector<double> choices = {0.03, 0.1, 0.3, 1, 3, 10};
  int starts = 24;  // per image; fewer if there are many images
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"ridge", ridge, above(0, 1e6)},
            {"usual", default_ridge, above(0, 1e6)},
            {"choices", choices, above(0, 1e6)},
            {"starts", starts, range(4, 200), "--starts",
             "number of random initial shapes for each face"}};
  }
  void check() const;
};

// Each stage is trained on features at points that were moved by the earlier adapted stages. These
// were trained without the image, so that the errors are those of unseen images.
[[nodiscard]] regression::Descent adapt_descent(const regression::Descent& base,
                                                const std::vector<regression::TrainingFace>& faces,
                                                const std::vector<regression::Start>& starts,
                                                double ridge, const std::stop_token& stop);
// Changes only the last layer.
[[nodiscard]] regression::RegressionNetwork adapt_network(
    const regression::RegressionNetwork& base, const std::vector<regression::TrainingFace>& faces,
    const std::vector<regression::Start>& starts, double ridge, const std::stop_token& stop);
// Changes only the leaves of the last level.
[[nodiscard]] regression::Trees adapt_trees(const regression::Trees& base,
                                            const std::vector<regression::TrainingFace>& faces,
                                            const std::vector<regression::Start>& starts,
                                            double ridge, const std::stop_token& stop);

struct AdaptedModel {
  LandmarkModel model;
  int faces = 0;
  double ridge = 0;
  bool ridge_chosen = false;  // by held-out images
  bool base_kept = false;     // the base is as good on held-out images: nothing was changed
  // Mean distance of a point from its true position on held-out images, in sizes of the shape: of
  // the base, and of models adapted without the image. 0 if unknown (< 3 images).
  double base_error = 0;
  double adapted_error = 0;
  std::vector<std::string> skipped;  // "path: reason"
};

// Throws InputError (no usable image, another number of points), Interrupted; std::invalid_argument
// if the base has neither trees nor descent. The result does not depend on the number of threads.
[[nodiscard]] AdaptedModel adapt_landmark_model(const LandmarkModel& base,
                                                const shape::LandmarkSet& set,
                                                const std::string& set_path,
                                                const AdaptOptions& options, Progress& progress,
                                                const std::stop_token& stop);

}  // namespace tarsier::face::landmarks
