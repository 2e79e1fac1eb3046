// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/plate/networks/recognizer.h"

#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::plate {

struct FoundCounts {
  int images = 0;
  int finds = 0;   // of which
  int plates = 0;  // are plates of the truth (intersection over union of the boxes 0.5)
  int texts = 0;   // plates whose text the truth has, in whole,
  int right = 0;   // and of these read right
};

// Fits ReaderModel's `confidence` and `character` curves to the plates whose text is known, and then
// its `judge` to all finds: those that are a plate of the truth against those that touch none (0.3 of the
// smaller box). Parts of plates and frames around them are neither. Curves stay as they are where
// fewer than 100 plates have texts. `folders`: each with images/ and truth.csv, or of images without plates.
// Throws InputError; std::invalid_argument for no finds.
FoundCounts fit_to_found(const DetectorModel& detector, const CountryChoice& countries,
                         const std::vector<std::string>& folders, ReaderModel& model,
                         Progress& progress, const std::stop_token& stop);

}  // namespace tarsier::plate
