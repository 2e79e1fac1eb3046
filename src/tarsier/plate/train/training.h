// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/plate/networks/networks.h"
#include "tarsier/plate/networks/recognizer.h"
#include "tarsier/plate/train/training_views.h"

#include <cstdint>
#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::plate {

struct TrainingOptions {
  std::uint64_t seed = 1;
  int detector_steps = 3000;  // batches of 32
  int aligner_steps = 2500;
  int line_steps = 6000;
  // Of a line reader that goes on from another: (1 - keep) of what it learnt and keep of that one, number by
  // number. The mean of the two often reads better than either where the images differ from what was learnt
  // from (Wortsman et al., "Robust fine-tuning of zero-shot models", CVPR 2022).
  double keep = 0;

  [[nodiscard]] OptionFields fields() {
    return {{"detector_steps", detector_steps, range(1, 1'000'000), "--steps",
             "batches of 32 for finding"},
            {"aligner_steps", aligner_steps, range(1, 1'000'000), "--aligner-steps",
             "batches of 32 for corners"},
            {"line_steps", line_steps, range(1, 1'000'000), "--steps", "batches of 32"},
            {"keep", keep, range(0, 1), "--keep",
             "share of the numbers of --from in the model: 0.5 is the mean of before and after"}};
  }
  void check() const { check_fields(*this); }
};

// Learns to find plates. Prints nothing; reports through `progress`.
[[nodiscard]] linalg::Network train_detector(const ViewMaker& views, const TrainingOptions& options,
                                             Progress& progress, std::stop_token stop);
// What a detector takes for plates in images where the truth knows none: the aligner has to
// learn better.
[[nodiscard]] std::vector<Distractor> find_distractors(const std::vector<Scene>& scenes,
                                                       const linalg::Network& detector);
[[nodiscard]] linalg::Network train_aligner(const ViewMaker& views, const TrainingOptions& options,
                                            Progress& progress, std::stop_token stop);
// `crops` may be empty: then from drawn plates alone. With `start`, a network of line_network()'s
// layers, it goes on from there with smaller steps: what it can stays mostly as it is, and a few
// crops and some hundred steps teach it a typeface. Throws std::invalid_argument for another one.
[[nodiscard]] linalg::Network train_line_reader(const ViewMaker& views,
                                                const std::vector<LabelledCrop>& crops,
                                                const TrainingOptions& options, Progress& progress,
                                                std::stop_token stop,
                                                const linalg::Network* start = nullptr);

// Fits Recognizer's confidence to how often it reads drawn plates right: logistic regression by
// Newton's method with a little ridge, on `count` plates.
[[nodiscard]] Calibration fit_calibration(const Recognizer& recognizer, const ViewMaker& views,
                                          int count, std::uint64_t seed, Progress& progress,
                                          std::stop_token stop);

// Characters of labelled crops whose boxes are given: how many, and how many are read wrong (the
// likeliest symbol in the columns of the box's middle).
struct CharacterErrors {
  int characters = 0;
  int wrong = 0;
};
[[nodiscard]] CharacterErrors test_line_reader(const linalg::Network& network,
                                               const std::vector<LabelledCrop>& crops);

// Single examples, for looking at and for tests.
void make_detector_example(const ViewMaker& views, Rng& rng, linalg::Shape& shape,
                           std::vector<float>& input, std::vector<float>& target);
void make_aligner_example(const ViewMaker& views, Rng& rng, linalg::Shape& shape,
                          std::vector<float>& input, std::vector<float>& target);
void make_line_example(const ViewMaker& views, const std::vector<LabelledCrop>& crops, Rng& rng,
                       linalg::Shape& shape, std::vector<float>& input, std::vector<float>& target);

}  // namespace tarsier::plate
