// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/face/recognition/recognizer.h"

// Comparison of two faces of people who are not enrolled. Templates and calibration come from a
// background alone, so they do not depend on a gallery.
namespace tarsier::face::recognition {

struct PairScores {
  // Without people. The calibration is that of two images of different people (a gallery of one
  // person with one image): threshold(rate, 1) is the score that two strangers reach at that rate.
  Recognizer model;
  double same_camera = 0;  // part of that score that is due to one camera, see same_camera.h
  // The background's mean counts as this number of people, relative to those that were observed.
  double background_weight = 1;
};

// Mean and standard deviation are those of pairs of strangers drawn from the background, corrected
// for people in front of the same camera (same_camera.h). Deterministic. Throws
// std::invalid_argument for a background without directions.
[[nodiscard]] PairScores pair_scores(const Background& background);

}  // namespace tarsier::face::recognition
