// SPDX-License-Identifier: MIT
#pragma once

#include <opencv2/core/types.hpp>

#include <optional>
#include <vector>

namespace tarsier::sfm {

// Places rectangles in a square. The highest come first, each where its top is lowest on the
// skyline of the placed ones (Burke, Kendall and Whitwell, "A new placement heuristic for the
// orthogonal stock-cutting problem", Operations Research 2004, as the bottom-left skyline). Returns
// top left corners in the order of `sizes`; empty where they do not fit.
[[nodiscard]] std::optional<std::vector<cv::Point>> pack(const std::vector<cv::Size>& sizes,
                                                         int side);

}  // namespace tarsier::sfm
