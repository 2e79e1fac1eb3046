// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/recognition/recognizer.h"

// What two faces of nobody who is enrolled have in common: templates and their calibration from a
// background alone, so that they depend on no gallery and stay what they are.
namespace tarsier::face::recognition {

struct PairScores {
  // Without people. Its calibration is that of two images of different people (a gallery of one
  // person with one image): threshold(rate, 1) is the score that two strangers reach at that rate.
  Recognizer model;
  double same_camera = 0;  // how much of that score is due to one camera, see same_camera.h
  // The background's mean counts as so many people beside those that were seen.
  double background_weight = 1;
};

// Mean and spread are those of pairs of strangers drawn from the background, moved by what
// strangers before one camera score more (same_camera.h). Same result each time. Throws
// std::invalid_argument for a background without directions.
[[nodiscard]] PairScores pair_scores(const Background& background);

}  // namespace tarsier::face::recognition
