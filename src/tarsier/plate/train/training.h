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
  // For a line reader that is fine-tuned: its weights are (1 - keep) times the new ones plus keep
  // times those of the start network. This mean is often more accurate than either network if the
  // test images differ from the training images (Wortsman et al., "Robust fine-tuning of zero-shot
  // models", CVPR 2022).
  double keep = 0;

  [[nodiscard]] OptionFields fields() {
    return {
        {"detector_steps", detector_steps, range(1, 1'000'000), "--steps",
         "training steps of the detector, batches of 32"},
        {"aligner_steps", aligner_steps, range(1, 1'000'000), "--aligner-steps",
         "training steps of the aligner (corners), batches of 32"},
        {"line_steps", line_steps, range(1, 1'000'000), "--steps", "training steps, batches of 32"},
        {"keep", keep, range(0, 1), "--keep",
         "weight of the parameters of --from in the result; 0.5: mean of old and new"}};
  }
  void check() const { check_fields(*this); }
};

// Trains the detector. Prints nothing; reports through `progress`.
[[nodiscard]] linalg::Network train_detector(const ViewGenerator& views,
                                             const TrainingOptions& options, Progress& progress,
                                             std::stop_token stop);
// Finds the false positives of a detector in images without plates there: hard negatives for the
// aligner.
[[nodiscard]] std::vector<HardNegative> find_hard_negatives(const std::vector<Scene>& scenes,
                                                            const linalg::Network& detector);
[[nodiscard]] linalg::Network train_aligner(const ViewGenerator& views,
                                            const TrainingOptions& options, Progress& progress,
                                            std::stop_token stop);
// Trains the line reader. Without `crops`, it learns from synthetic plates alone. `start`, a
// network with the layers of line_network(), is fine-tuned with smaller steps: it keeps most of its
// accuracy, and a few crops and some hundred steps teach it a new typeface. Throws
// std::invalid_argument if `start` has other layers.
[[nodiscard]] linalg::Network train_line_reader(const ViewGenerator& views,
                                                const std::vector<LabelledCrop>& crops,
                                                const TrainingOptions& options, Progress& progress,
                                                std::stop_token stop,
                                                const linalg::Network* start = nullptr);

// Fits the confidence of Recognizer to its accuracy on `count` synthetic plates, by logistic
// regression (Newton's method with a small ridge).
[[nodiscard]] Calibration fit_calibration(const Recognizer& recognizer, const ViewGenerator& views,
                                          int count, std::uint64_t seed, Progress& progress,
                                          const std::stop_token& stop);

// The characters of labelled crops with given boxes, and how many of them are read wrong. The
// result for a character is the most probable symbol in the columns of its box's centre.
struct CharacterErrors {
  int characters = 0;
  int wrong = 0;
};
[[nodiscard]] CharacterErrors evaluate_line_reader(const linalg::Network& network,
                                                   const std::vector<LabelledCrop>& crops);

// Single examples, for inspection and tests.
void make_detector_example(const ViewGenerator& views, Rng& rng, linalg::Shape& shape,
                           std::vector<float>& input, std::vector<float>& target);
void make_aligner_example(const ViewGenerator& views, Rng& rng, linalg::Shape& shape,
                          std::vector<float>& input, std::vector<float>& target);
void make_line_example(const ViewGenerator& views, const std::vector<LabelledCrop>& crops, Rng& rng,
                       linalg::Shape& shape, std::vector<float>& input, std::vector<float>& target);

}  // namespace tarsier::plate
