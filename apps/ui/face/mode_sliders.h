// SPDX-License-Identifier: MIT
#pragma once

// Shared by the sessions that show the modes of a model.
namespace tarsier {

inline constexpr double kMaxSigmas = 3;   // range of a slider, standard deviations of its mode
inline constexpr int kStatusHeight = 40;  // px, for the status below the image

}  // namespace tarsier
