// SPDX-License-Identifier: MIT
#pragma once

#include "framework/cli.h"
#include <string>
#include <vector>

namespace tarsier::cli {

struct ClassicTrainFlags {
  std::vector<std::string> inputs;
  std::string output;
  std::string terms;
  std::string features = "pixels";  // of the detector
  double cost = 0.1;
  std::string reader = "hog";
  int low = 10;
  int neurons = 20;
};

void add_classic_detector_flags(Command& verb, ClassicTrainFlags& flags);
void add_classic_reader_flags(Command& verb, ClassicTrainFlags& flags);

// `plate train-detector --pipeline classic`: the SVM. One input.
[[nodiscard]] ExitStatus train_classic_detector(const ClassicTrainFlags& flags, Context& context);
// `plate train-reader --pipeline classic`: the character reader. One input.
[[nodiscard]] ExitStatus train_classic_reader(const ClassicTrainFlags& flags, Context& context);

}  // namespace tarsier::cli
