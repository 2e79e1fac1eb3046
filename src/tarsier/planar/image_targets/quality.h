// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/image_targets/target.h"

#include <opencv2/core.hpp>

#include <cstdint>
#include <stop_token>

namespace tarsier::planar::image_targets {

// How well a trained image can be found and followed, and what is wrong with it. Besides counting
// features, their spread and their likes elsewhere in the image, it is drawn `trials` times (see
// rehearse()) and looked for. Throws Interrupted.
[[nodiscard]] Quality rate_target(const Target& target, int trials, std::uint64_t seed,
                                  const std::stop_token& stop);

// The image with its features (green: they stood the trials; red: another place looks the same),
// places without any (shaded), corners that are aligned (crosses), and a panel with the rating and
// its reasons. CV_8UC3.
[[nodiscard]] cv::Mat draw_quality(const Target& target);

}  // namespace tarsier::planar::image_targets
