// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>

namespace tarsier::sfm {

// Limits of COLMAP models, as text and binary. Files with more are not read: their numbers are
// taken for damaged.
inline constexpr std::size_t kMaxColmapItems = 1'000'000;       // cameras, images
inline constexpr std::size_t kMaxColmapFeatures = 500'000'000;  // in all images together
inline constexpr double kMaxColmapPixel = 1e7;  // px; coordinates in an image are smaller

}  // namespace tarsier::sfm
