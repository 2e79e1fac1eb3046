// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/progress.h"
#include "tarsier/plate/networks/recognizer.h"

#include <stop_token>
#include <string>
#include <vector>

namespace tarsier::plate {

struct WholeImageCounts {
  int images = 0;
  int detections = 0;
  int plates = 0;   // of these, plates of the truth (intersection over union of the boxes 0.5)
  int texts = 0;    // plates with a complete text in the truth
  int correct = 0;  // of these, read correctly
};

// Fits ReaderModel's `confidence_curve` and `character_curve` to the plates with a known text. Then
// fits its `plate_classifier` to all detections: positive examples are plates of the truth,
// negative ones touch no plate of the truth (0.3 of the smaller box). Parts of plates and the
// frames around them are not used. The curves do not change if fewer than 100 plates have texts.
// `folders`: each has images/ and truth.csv, or holds images without plates. Throws InputError, and
// std::invalid_argument if there are no detections.
WholeImageCounts fit_to_whole_images(const DetectorModel& detector, const CountryChoice& countries,
                                     const std::vector<std::string>& folders, ReaderModel& model,
                                     Progress& progress, const std::stop_token& stop);

}  // namespace tarsier::plate
