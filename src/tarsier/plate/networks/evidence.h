// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/plate/networks/networks.h"
#include "tarsier/plate/text/reading.h"

#include <array>
#include <string>
#include <vector>

// What speaks for a place being a plate, and for what is read there being right.
namespace tarsier::plate {

// ln of the reading's confidence, at least ln 1e-5.
[[nodiscard]] double log_confidence(const Reading& reading);

// Corrects log odds x by a line with two bends:
//   w0 + w1 x + w2 max(0, x - 2) + w3 max(0, -1 - x)
// Fitted to plates of whole images (Platt, 1999, with bends), as logistic regression on drawn views is too shy
// in the middle.
struct OddsCurve {
  std::array<double, 4> weights{0, 1, 0, 0};
  [[nodiscard]] static std::array<double, 4> features(double odds);
  [[nodiscard]] double operator()(double odds) const;
};

// What is known of a find, besides the others of its image; in this order the weights of
// PlateJudge.
//   0 1
//   1 log_odds() of the aligner's score
//   2 ln(p / (1 - p)) of the detector's surest cell, p kept 1e-3 from both ends
//   3 mean ln of the characters' confidences, each at least 1e-3
//   4 min(0, ln(text height in px / 20)): little is to be read in small plates
//   5 characters
//   6 1 where the text has no digit
//   7 1 where it fits a country's layout
//   8 share of different symbols among the characters: grilles and lamps repeat one
//   9 nats by which another find of the image is more certainly a plate, 0..8
using FindFeatures = std::array<double, 10>;

// The chance that a find is a plate, by logistic regression on FindFeatures.
struct PlateJudge {
  // Where a model file has none: those that plate-reader.json was shipped with first.
  FindFeatures weights{-7.14, 0.28, 0.40, 1.65, -2.50, 0.34, -2.50, 1.35, 1.68, -0.83};
  [[nodiscard]] double odds(const FindFeatures& features) const;
};

// What is lettered at a place; `confidences` as of Decoded.
struct Lettering {
  std::string text;
  std::vector<double> confidences;
  std::string country;
};

// The last feature is 0: the other finds are not known yet.
[[nodiscard]] FindFeatures find_features(const Detection& detection, const Alignment& alignment,
                                         const Lettering& lettering);

// Fills in the last feature of each: by ln(confidence) + log_odds(plate) of the readings, where
// `plate` is the aligner's score still. Overlapping finds (box_overlap_of_smaller() of 0.3) do not count: they are
// rivals for one place. The two have the same size.
void compare(const std::vector<Reading>& readings, std::vector<FindFeatures>& features);

}  // namespace tarsier::plate
