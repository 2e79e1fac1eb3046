// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/plate/classic/character_reader.h"

#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::plate {

// A study of a character reader: every feature size with every number of hidden neurons, each over
// repeated random splits.
struct StudyOptions {
  ReaderKind kind = ReaderKind::kMlp;
  std::vector<int> thumbnail_sizes{5, 10, 15, 20};  // px, sides of the small image
  std::vector<int> neurons{10, 20, 30, 40, 60, 80, 100, 150, 200, 300, 400, 500};
  int seeds = 10;        // number of splits
  int train = 571;       // characters in the training set
  int iterations = 100;  // of the MLP's training
  std::uint64_t seed = 1;

  [[nodiscard]] OptionFields fields() {
    return {{"lows", thumbnail_sizes, range(1, 20), "--features", "px, sides of the input image"},
            {"neurons", neurons, range(1, 1000), "--neurons", "numbers of hidden neurons"},
            {"seeds", seeds, range(1, 1000), "--splits,--seeds", "random splits for each setting"},
            {"train", train, at_least(30), "--train",
             "number of training characters; the rest is the test set"},
            {"iterations", iterations, range(1, 100000), "--iterations", "training iterations"}};
  }
  void check() const;
};

struct StudyCell {
  int thumbnail_size = 0;
  int neurons = 0;             // 0: a reader without hidden neurons
  std::vector<double> errors;  // of each split, 0..1
  [[nodiscard]] double mean() const;
  [[nodiscard]] double deviation() const;  // standard deviation over the splits; 0 for one split
};

// Cells in the order of feature size, then neurons. Splits run in parallel; the result does not
// depend on this. Throws Interrupted.
[[nodiscard]] std::vector<StudyCell> study_reader(const CharacterSet& set,
                                                  const StudyOptions& options, Progress& progress,
                                                  const std::stop_token& stop);

// A header "features,neurons,splits,error_mean,error_deviation" and the lines.
[[nodiscard]] std::string study_csv(const std::vector<StudyCell>& cells);

}  // namespace tarsier::plate
