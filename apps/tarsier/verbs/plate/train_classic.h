// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/classic/character_reader.h"
#include "tarsier/plate/classic/plate_svm.h"

#include "framework/cli.h"
#include <string>
#include <vector>

namespace tarsier::cli {

struct ClassicTrainFlags {
  std::vector<std::string> inputs;
  std::string output;
  std::string terms;
  std::string features = "pixels";  // of the detector
  plate::PlateSvmOptions svm;
  std::string reader = "hog";
  plate::CharacterReaderOptions characters;
};

void add_classic_detector_flags(Command& verb, ClassicTrainFlags& flags);
void add_classic_reader_flags(Command& verb, ClassicTrainFlags& flags);

// `plate train-detector --pipeline classic`: the SVM. One input.
[[nodiscard]] ExitStatus train_classic_detector(const ClassicTrainFlags& flags, Context& context);
// `plate train-reader --pipeline classic`: the character reader. One input.
[[nodiscard]] ExitStatus train_classic_reader(const ClassicTrainFlags& flags, Context& context);

}  // namespace tarsier::cli
