// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/types.hpp>

#include <optional>
#include <vector>

namespace tarsier::sfm {

// Places for rectangles in a square: the highest first, each where its top ends lowest on the skyline of those
// before (Burke, Kendall and Whitwell, "A new placement heuristic for the orthogonal
// stock-cutting problem", Operations Research 2004, as the bottom-left skyline). Top left corners,
// in the order of `sizes`; nothing where they do not fit.
[[nodiscard]] std::optional<std::vector<cv::Point>> pack(const std::vector<cv::Size>& sizes,
                                                         int side);

}  // namespace tarsier::sfm
