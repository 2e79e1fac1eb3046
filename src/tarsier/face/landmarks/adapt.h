// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/landmarks/training_face.h"

#include <cstdint>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

// A model adapted to one person, camera or markup from a few annotated images: each regression
// moves from the general one R0 as far as the images ask for (maximum a posteriori under a
// Gaussian prior around R0),
//   R = argmin |D - Phi R|^2 + lambda |R - R0|^2,
// Phi: what the stage sees at starts scattered around the faces (descent: its descriptors and a
// constant; trees: the leaves of the last level; network: what its last layer sees), D: the steps to the true points. Solved in its
// dual form, whose size is the number of starts. Shape model, patches, quality and visibility stay.
namespace tarsier::face::landmarks {

struct AdaptOptions {
  // lambda in units of (starts of an image) x (mean squared norm of a row of Phi): 1 weighs the
  // prior like one image. Nothing: the best of `choices` on images left out, where there are 3
  // at least, else `usual`.
  std::optional<double> ridge;
  double usual = 0.3;
  std::vector<double> choices = {0.03, 0.1, 0.3, 1, 3, 10};
  int starts = 24;  // of each image; fewer where there are many images
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"ridge", ridge, above(0, 1e6)},
            {"usual", usual, above(0, 1e6)},
            {"choices", choices, above(0, 1e6)},
            {"starts", starts, range(4, 200), "--starts", "scattered around each face"}};
  }
  void check() const;
};

// Each stage's features at points that the adapted stages before it have moved - of images left
// out, so that a stage learns from errors as they are on images never seen.
[[nodiscard]] Descent adapt_descent(const Descent& base, const std::vector<TrainingFace>& faces,
                                    const std::vector<Start>& starts, double ridge,
                                    const std::stop_token& stop);
// Only the last layer changes.
[[nodiscard]] RegressionNetwork adapt_network(const RegressionNetwork& base,
                                              const std::vector<TrainingFace>& faces,
                                              const std::vector<Start>& starts, double ridge,
                                              const std::stop_token& stop);
// Only the leaves of the last level change.
[[nodiscard]] Trees adapt_trees(const Trees& base, const std::vector<TrainingFace>& faces,
                                const std::vector<Start>& starts, double ridge,
                                const std::stop_token& stop);

struct AdaptedModel {
  LandmarkModel model;
  int faces = 0;
  double ridge = 0;
  bool chosen = false;  // by leaving images out
  bool kept = false;    // the base is as good on images left out: nothing was changed
  // Mean distance of a point from its true place on images left out, in sizes of the shape: of
  // the base, and of models adapted without the image. 0 where they are not known (< 3 images).
  double before = 0;
  double after = 0;
  std::vector<std::string> skipped;  // "path: reason"
};

// Throws InputError (nothing usable, another number of points), Interrupted;
// std::invalid_argument where the base has neither trees nor descent. The same result for any
// number of threads.
[[nodiscard]] AdaptedModel adapt_landmark_model(const LandmarkModel& base,
                                                const shape::LandmarkSet& set,
                                                const std::string& set_path,
                                                const AdaptOptions& options, Progress& progress,
                                                const std::stop_token& stop);

}  // namespace tarsier::face::landmarks
