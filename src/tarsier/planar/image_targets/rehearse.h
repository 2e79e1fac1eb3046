// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/image_targets/target.h"

#include <cstdint>
#include <stop_token>
#include <vector>

namespace tarsier::planar::image_targets {

// One random view of the target before a plain ground: small, turned, tilted up to 60 degrees, dim,
// blurred and noisy. 640x480 px, CV_8UC1; `h`: px of it from px of the image.
struct TrialView {
  cv::Mat gray;
  cv::Matx33d h;
};
[[nodiscard]] TrialView trial_view(const Target& target, int trial, std::uint64_t seed);

// What trials showed of each trained feature.
struct Rehearsal {
  std::vector<int> right;  // how often a feature of a view was rightly matched to it
  std::vector<int> wrong;  // how often wrongly
  double repeatable = 0;   // 0..1, of the trials: part of a view's features on the image that were
                           // rightly matched, the median
};

// Matches the features of `trials` views against the target. The same for the same seed. Throws
// Interrupted.
[[nodiscard]] Rehearsal rehearse(const Target& target, int trials, std::uint64_t seed,
                                 const std::stop_token& stop);

// Keeps the `most` features that did best, in their order; those that were never matched rightly
// only as far as there is room.
void keep_best(Target& target, const Rehearsal& rehearsal, std::size_t most);

}  // namespace tarsier::planar::image_targets
