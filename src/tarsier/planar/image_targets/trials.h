// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/image_targets/target.h"

#include <cstdint>
#include <stop_token>
#include <vector>

namespace tarsier::planar::image_targets {

// One random view of the target on a uniform background: small, rotated, tilted up to 60 degrees,
// dim, blurred and noisy. 640x480 px, CV_8UC1. `h`: from px of the image to px of the view.
struct TrialView {
  cv::Mat gray;
  cv::Matx33d h;
};
[[nodiscard]] TrialView trial_view(const Target& target, int trial, std::uint64_t seed);

// Statistics of each trained feature over the trials.
struct TrialResult {
  std::vector<int> correct;  // number of correct matches
  std::vector<int> wrong;    // number of wrong matches
  // 0..1: median over the trials of the share of a view's features on the image that were matched
  // correctly.
  double repeatability = 0;
};

// Matches the features of `trials` views with the target. Deterministic for a given seed. Throws
// Interrupted.
[[nodiscard]] TrialResult run_trials(const Target& target, int trials, std::uint64_t seed,
                                     const std::stop_token& stop);

// Keeps the `max_features` best features, in their order. Features without a correct match are kept
// only if there is room.
void keep_best_features(Target& target, const TrialResult& result, std::size_t max_features);

}  // namespace tarsier::planar::image_targets
