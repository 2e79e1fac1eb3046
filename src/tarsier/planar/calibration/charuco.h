// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/planar/calibration/detect.h"

namespace tarsier::planar::calibration {

// Half the maximum window for the refinement of a corner (cv::cornerSubPix).
inline constexpr int kMaxHalfWindow_px = 11;

// The charuco part of find_board(). `gray` is CV_8UC1.
[[nodiscard]] BoardView find_charuco(const cv::Mat& gray, const BoardSpec& spec, int min_corners);

}  // namespace tarsier::planar::calibration
