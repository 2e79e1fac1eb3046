// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/networks/networks.h"
#include "tarsier/plate/text/reading.h"

#include <array>
#include <string>
#include <vector>

// Evidence that a region is a plate, and that its text is correct.
namespace tarsier::plate {

// ln of the reading's confidence; at least ln 1e-5.
[[nodiscard]] double log_confidence(const Reading& reading);

// Corrects log odds x by a piecewise linear function with two bends:
//    w0 + w1 x + w2 max(0, x - 2) + w3 max(0, -1 - x)
// It is fitted to the plates of whole images (Platt, 1999, with bends), because the logistic
// regression on synthetic views is underconfident in the middle range.
struct CalibrationCurve {
  std::array<double, 4> weights{0, 1, 0, 0};
  [[nodiscard]] static std::array<double, 4> features(double odds);
  [[nodiscard]] double operator()(double odds) const;
};

// Features of a detection, in the order of the weights of PlateClassifier:
//    0 1
//    1 log_odds() of the aligner's score
//    2 ln(p / (1 - p)) of the detector's best cell, p limited to 1e-3 .. 1 - 1e-3
//    3 mean ln of the characters' confidences, each at least 1e-3
//    4 min(0, ln(text height in px / 20)): small plates are hard to read
//    5 number of characters
//    6 1 if the text has no digit
//    7 1 if it fits a country's layout
//    8 share of different symbols among the characters: grilles and lamps repeat one symbol
//    9 nats by which another detection of the image is more certainly a plate, 0..8
using PlateClassifierFeatures = std::array<double, 10>;

// Probability that a detection is a plate, by logistic regression on PlateClassifierFeatures.
struct PlateClassifier {
  // Used if the model file has no weights.
  PlateClassifierFeatures weights{-7.14, 0.28, 0.40, 1.65, -2.50, 0.34, -2.50, 1.35, 1.68, -0.83};
  [[nodiscard]] double log_odds(const PlateClassifierFeatures& features) const;
};

// The text found at a region; `confidences` as in DecodedText.
struct RegionText {
  std::string text;
  std::vector<double> confidences;
  std::string country;
};

// The last feature is 0 because the other detections are not known yet.
[[nodiscard]] PlateClassifierFeatures plate_classifier_features(const Detection& detection,
                                                                const Alignment& alignment,
                                                                const RegionText& text);

// Sets the last feature of each detection from ln(confidence) + log_odds(plate) of the readings.
// Here `plate` still is the aligner's score. Overlapping detections (box_overlap_of_smaller() of
// 0.3) are ignored because they compete for one plate. Both vectors have the same size.
void set_relative_evidence(const std::vector<Reading>& readings,
                           std::vector<PlateClassifierFeatures>& features);

}  // namespace tarsier::plate
