// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/image_targets/target.h"

#include <opencv2/core.hpp>

#include <cstdint>
#include <stop_token>

namespace tarsier::planar::image_targets {

// Rates how well a trained image can be detected and tracked, and gives reasons. The features are
// counted, and their spread and their similarity to other places of the image are measured. Then
// detection is tried on `trials` synthetic views (see run_trials()). Throws Interrupted.
[[nodiscard]] Quality rate_target(const Target& target, int trials, std::uint64_t seed,
                                  const std::stop_token& stop);

// Draws the image with its features (green: repeatable in the trials; red: similar to another
// place), regions without features (shaded), corners used for alignment (crosses), and a panel with
// the rating and its reasons. CV_8UC3.
[[nodiscard]] cv::Mat draw_quality(const Target& target);

}  // namespace tarsier::planar::image_targets
